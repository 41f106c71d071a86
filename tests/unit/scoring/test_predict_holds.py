"""Predictions and decisions of many holds: no sample after the cut-off is used; their scores."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command

from palpate import read_holds, score
from palpate.errors import InputError
from palpate.holds import Hold, measure_settled_value
from palpate.measurement import Status
from palpate.scoring import predictions as evaluate
from palpate.scoring.deciding import EARLIEST_S, find_decision
from palpate.scoring.predictions import Prediction, decide_holds, predict_holds, summarise
from palpate.settling.baselines import LogLaw, Recorded
from palpate.settling.exponential import Exponential
from palpate.settling.relaxation import Relaxation
from palpate_studies.bootstrap import bootstrap_interval

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


TIME_S = np.arange(0.0, 21.0, 0.07)
HOLD = 100.0 - 4.0 * np.log(TIME_S + 0.5)


def test_find_decision_smaller_half_width_decides_later() -> None:
    loose, strict = (
        find_decision(TIME_S, HOLD, method=Relaxation(), half_width_percent=percent)
        for percent in (8.0, 2.0)
    )
    assert loose.decided
    assert strict.decided
    assert EARLIEST_S < loose.time_s < strict.time_s
    half_width = (strict.estimate.high - strict.estimate.low) / 2
    assert half_width <= 0.02 * strict.estimate.value


def test_measure_settled_value_is_the_mean_of_the_last_half_second_up_to_the_horizon() -> None:
    time_s = np.array([0.0, 19.4, 19.5, 19.75, 20.0, 20.25])
    values = np.array([9.0, 8.0, 1.0, 2.0, 6.0, 100.0])
    assert measure_settled_value(time_s, values, horizon_s=20.0) == 3.0
    for time_s, reaches in (
        (np.array([0.0, 10.0, 30.0]), False),
        (np.arange(0, 19.91, 0.05), False),
        (np.arange(0, 19.96, 0.05), True),
    ):
        settled = measure_settled_value(time_s, np.ones(time_s.size), horizon_s=20.0)
        assert np.isfinite(settled) == reaches


def test_summarise_ignores_unknown_values() -> None:
    fixed = {"hold_id": "a", "method": "m", "cutoff_s": 1.0, "status": Status.OK}
    rows = [
        Prediction(
            predicted=value,
            low=value - half,
            high=value + half,
            settled=known,
            recorded=last,
            **fixed,
        )
        for value, half, known, last in (
            (101.0, 2.0, 100.0, 110.0),
            (98.0, 1.0, 100.0, 104.0),
            (103.0, 1.0, 100.0, 106.0),
            (7.0, 1.0, np.nan, 9.0),
            (1.0, 1.0, 0.0, 1.0),
        )
    ]
    *scores, no_base = rows
    summary = summarise(scores)
    assert summary["median_abs_error_percent"] == 2.0
    assert summary["mean_abs_error_percent"] == 2.0
    assert summary["p90_abs_error_percent"] == pytest.approx(2.8)
    assert summary["median_error_of_remaining_percent"] == 50.0
    assert summary["coverage"] == pytest.approx(1 / 3)
    assert summary["median_half_width_percent"] == 1.0
    assert np.isnan(no_base.error_percent)
    assert (no_base.of_remaining_percent, no_base.coverage) == (100.0, 1.0)


def test_bootstrap_interval_resamples_specimens_not_holds() -> None:
    values = np.repeat([0.0, 1.0], 50)
    groups = ["a"] * 50 + ["b"] * 50
    by_specimen = bootstrap_interval(values, groups, statistic=np.mean)
    by_hold = bootstrap_interval(values, [str(i) for i in range(100)], statistic=np.mean)
    assert by_specimen == (0.0, 1.0)
    assert 0.4 < by_hold[0] < by_hold[1] < 0.6


NAMES, CUTOFFS_S = ["relaxation", "recorded"], [1.0, 2.5]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path, time_s = tmp_path / "holds.csv", np.arange(0.0, 25.0, 0.1)
    with path.open("w") as file:
        file.write("hold_id,time_s,value\n")
        for name, top in (("a", 900.0), ("b", 700.0)):
            file.writelines(f"{name},{t:.1f},{top - 60 * np.log1p(t):.2f}\n" for t in time_s)
    return path


def test_score_agrees_with_the_settle_command(path: Path, palpate: Command) -> None:
    options = [text for name in NAMES for text in ("--method", name)]
    options += [text for cutoff_s in CUTOFFS_S for text in ("--cutoff", str(cutoff_s))]
    table = score(read_holds(path), methods=NAMES, cutoffs_s=CUTOFFS_S)
    printed = palpate("settle", path, *options, "--json").document
    assert table.to_dict()["summary"] == printed["summary"]
    lines = [line.rstrip() for line in palpate("settle", path, *options).out.splitlines()]
    assert [line for line in str(table).splitlines() if line.rstrip() not in lines] == []


def test_score_compares_own_methods_with_those_by_name(path: Path) -> None:
    mine = LogLaw(name="mine", from_s=1.0)
    holds = read_holds(path)
    rows = {row["method"]: row for row in score(holds, methods=["recorded", mine]).summary()}
    assert rows["mine"]["median_abs_error_percent"] < 0.3
    assert rows["recorded"]["median_abs_error_percent"] > 5.0
    with pytest.raises(InputError, match="two methods are named 'mine'"):
        score(holds, methods=[mine, LogLaw(name="mine", from_s=2.0)])


def test_score_to_dataframe_has_a_row_per_method_and_cutoff(path: Path) -> None:
    frame = score(read_holds(path), methods=NAMES, cutoffs_s=CUTOFFS_S)
    table = frame.to_dataframe()
    assert list(zip(table["method"], table["cutoff_s"], strict=True)) == [
        (method, cutoff_s) for method in NAMES for cutoff_s in CUTOFFS_S
    ]
    assert (table["holds"] == 2).all()
    pandas = pytest.importorskip("pandas")
    pandas.testing.assert_frame_equal(pandas.DataFrame(frame), table)
