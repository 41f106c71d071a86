"""Predictions of many holds: order, batches, and no use of samples after the cut-off."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.holds import Hold
from palpate.measurement import Status
from palpate.scoring import predictions as evaluate
from palpate.scoring.predictions import decide_holds, predict_holds
from palpate.settling.baselines import Recorded
from palpate.settling.exponential import Exponential
from palpate.settling.relaxation import Relaxation

METHODS = {"exponential": Exponential(), "recorded": Recorded()}


def hold(name: str, *, rate_hz: float = 15.0, until_s: float = 21.0, sink: float = 1.0) -> Hold:
    time_s = np.arange(0, until_s, 1 / rate_hz)
    values = 40 * np.exp(-1.2 * time_s) - 60 - sink * np.log(time_s + 0.5)
    return Hold(hold_id=name, channel=None, time_s=time_s, values=values)


def keys(rows: list) -> list[tuple]:
    return [(r.hold_id, r.method, r.cutoff_s, r.predicted, r.settled, r.status) for r in rows]


@pytest.mark.parametrize(("holds_at_a_time", "samples_at_a_time"), [(1, 10**9), (512, 400)])
def test_predict_holds_is_independent_of_batching(
    monkeypatch: pytest.MonkeyPatch, holds_at_a_time: int, samples_at_a_time: int
) -> None:
    holds = [hold("a"), hold("b", rate_hz=5), hold("c", sink=2.0), hold("d", until_s=9)]
    options = {"methods": METHODS, "cutoffs_s": (2.5, 1.0), "horizon_s": 20.0, "level": 0.9}
    together = keys(list(predict_holds(iter(holds), **options)))
    monkeypatch.setattr(evaluate, "HOLDS_AT_A_TIME", holds_at_a_time)
    monkeypatch.setattr(evaluate, "SAMPLES_AT_A_TIME", samples_at_a_time)
    apart = keys(list(predict_holds(iter(holds), **options)))
    assert [key[:3] for key in together] == [key[:3] for key in apart]
    np.testing.assert_allclose([k[3] for k in together], [k[3] for k in apart], rtol=1e-9)
    assert [key[:3] for key in together[:4]] == [
        ("a", "exponential", 2.5),
        ("a", "exponential", 1.0),
        ("a", "recorded", 2.5),
        ("a", "recorded", 1.0),
    ]
    assert [np.isnan(key[4]) for key in together[::4]] == [False, False, False, True]


def test_predict_holds_ignores_samples_after_the_cutoff() -> None:
    original = hold("a")
    is_later = original.time_s > 2.5
    changed = Hold(
        hold_id="a",
        channel=None,
        time_s=original.time_s,
        values=np.where(is_later, 1e6, original.values),
    )
    options = {"cutoffs_s": [2.5], "horizon_s": 20.0, "level": 0.9}
    methods = METHODS | {"relaxation": Relaxation()}
    first, second = (
        list(predict_holds([one], methods=methods, **options)) for one in (original, changed)
    )
    assert [row.predicted for row in first] == [row.predicted for row in second]
    assert [row.settled for row in first] != [row.settled for row in second]


def test_predict_holds_without_samples_before_cutoff_is_too_short() -> None:
    late = Hold(hold_id="a", channel="x", time_s=np.array([3.0, 20.0]), values=np.array([1.0, 2.0]))
    [row] = predict_holds(
        [late], methods={"recorded": Recorded()}, cutoffs_s=[2.5], horizon_s=20.0, level=0.9
    )
    assert row.status is Status.TOO_SHORT
    assert np.isnan([row.predicted, row.low, row.recorded]).all()
    assert (row.channel, row.settled) == ("x", 2.0)


def test_decide_holds_equals_prediction_at_the_decision_time() -> None:
    options = {"half_width_percent": 4.0, "horizon_s": 20.0, "level": 0.9}
    methods = {"relaxation": Relaxation()}
    [row] = decide_holds([hold("a")], methods=methods, **options)
    assert row.decided
    assert 0.5 <= row.cutoff_s < 20
    assert (row.high - row.low) / 2 <= 0.04 * abs(row.predicted)
    [same] = predict_holds(
        [hold("a")], methods=methods, cutoffs_s=[row.cutoff_s], horizon_s=20.0, level=0.9
    )
    assert same.predicted == pytest.approx(row.predicted, rel=1e-12)
