"""Settling learned from a sensor's own holds, on invented sheets that settle in their own way."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.holds import Hold
from palpate.settling.own import FEWEST, OwnRelaxation, shrunk_slope
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import FloatArray

TIME_S = np.arange(1, 303) / 15.0


def holds(seed: int, count: int, *, noise: float = 0.03) -> FloatArray:
    """Sheets that gain a fifth between 2.5 s and 20 s, late: no general prior expects that."""
    rng = np.random.default_rng(seed)
    level = -rng.uniform(20, 60, count)[:, None]
    share = 0.3 * np.exp(0.1 * rng.standard_normal(count))[:, None]
    shape = 1.0 - share * np.exp(-((TIME_S / 9.0) ** 1.5))
    return np.asarray(level * shape + noise * rng.standard_normal((count, TIME_S.size)))


def named(values: FloatArray) -> tuple[Hold, ...]:
    return tuple(
        Hold(hold_id=str(place), channel=None, time_s=TIME_S, values=row)
        for place, row in enumerate(values)
    )


def settled(values: FloatArray) -> FloatArray:
    return np.asarray(values[:, (TIME_S > 19.5) & (TIME_S <= 20.0)].mean(axis=1))


@pytest.fixture(scope="module")
def own() -> OwnRelaxation:
    return OwnRelaxation(holds=named(holds(1, 20)))


def test_own_holds_beat_the_general_prior(own: OwnRelaxation) -> None:
    tested = holds(2, 20)
    errors = [
        np.abs(predict_settled(TIME_S, tested, cutoff_s=2.5, method=method).value - settled(tested))
        for method in (own, Relaxation())
    ]
    assert np.median(errors[0]) < 0.5 * np.median(errors[1])


def test_intervals_cover_at_their_level(own: OwnRelaxation) -> None:
    tested = holds(3, 60)
    found = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    truth = settled(tested)
    assert 0.85 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 1.0
    assert np.all(found.high - found.low < 0.3 * np.abs(truth))


def test_the_unit_does_not_matter(own: OwnRelaxation) -> None:
    tested = holds(4, 3)
    same = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    scaled = OwnRelaxation(holds=named(7.0 * holds(1, 20)))
    other = predict_settled(TIME_S, 7.0 * tested, cutoff_s=2.5, method=scaled)
    assert other.value == pytest.approx(7.0 * same.value, rel=1e-3)
    assert np.all(other.low < other.high)


def test_at_the_horizon_nothing_is_left_to_learn(own: OwnRelaxation) -> None:
    tested = holds(6, 2)
    found = predict_settled(TIME_S, tested, cutoff_s=20.0, method=own)
    assert found.value == pytest.approx(settled(tested), abs=0.1)


def test_no_holds_are_refused() -> None:
    with pytest.raises(CalibrationError, match="no hold to learn from"):
        OwnRelaxation(holds=())


def test_holds_that_end_too_early_teach_nothing() -> None:
    short = TIME_S < 10.0
    taught = tuple(
        Hold(hold_id=h.hold_id, channel=None, time_s=TIME_S[short], values=h.values[short])
        for h in named(holds(7, 5))
    )
    tested = holds(8, 2)
    found, general = (
        predict_settled(TIME_S, tested, cutoff_s=2.5, method=method)
        for method in (OwnRelaxation(holds=taught), Relaxation())
    )
    assert found.value.tolist() == general.value.tolist()


def test_an_error_without_a_rule_is_not_learned() -> None:
    rng = np.random.default_rng(9)
    seen = np.ones(20)
    assert abs(shrunk_slope(rng.normal(0.0, 1.0, 20), seen)) < 0.3
    assert shrunk_slope(np.full(FEWEST - 1, 0.5), seen[: FEWEST - 1]) == 0.0
    assert shrunk_slope(0.5 + rng.normal(0.0, 0.01, 20), seen) == pytest.approx(0.5, abs=0.02)
