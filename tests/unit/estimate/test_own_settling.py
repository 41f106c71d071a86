"""Settling learned from a sensor's own holds, on invented sheets that settle in their own way."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.own_settling import OwnSettling
from palpate.holds import Hold
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
def own() -> OwnSettling:
    return OwnSettling(holds=named(holds(1, 20)))


def test_own_holds_beat_the_general_prior(own: OwnSettling) -> None:
    tested = holds(2, 20)
    errors = [
        np.abs(predict_settled(TIME_S, tested, cutoff_s=2.5, method=method).value - settled(tested))
        for method in (own, Relaxation())
    ]
    assert np.median(errors[0]) < 0.5 * np.median(errors[1])


def test_intervals_cover_at_their_level(own: OwnSettling) -> None:
    tested = holds(3, 60)
    found = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    truth = settled(tested)
    assert 0.75 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 1.0
    assert np.all(found.high - found.low < 0.3 * np.abs(truth))


def test_unit_and_sign_do_not_matter(own: OwnSettling) -> None:
    tested = holds(4, 3)
    same = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    ohm = OwnSettling(holds=named(-7.0 * holds(1, 20)))
    other = predict_settled(TIME_S, -7.0 * tested, cutoff_s=2.5, method=ohm)
    assert other.value == pytest.approx(-7.0 * same.value, rel=1e-3)
    assert np.all(other.low < other.high)


def test_a_hold_that_changes_sign_falls_back(own: OwnSettling) -> None:
    tested = holds(5, 2)
    tested[1] -= tested[1, 20]
    found = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    general = predict_settled(TIME_S, tested, cutoff_s=2.5, method=Relaxation())
    assert found.value[1] == general.value[1]
    assert str(found.status[1]) == "fell_back"


def test_at_the_horizon_nothing_is_left_to_learn(own: OwnSettling) -> None:
    tested = holds(6, 2)
    found = predict_settled(TIME_S, tested, cutoff_s=20.0, method=own)
    assert found.value == pytest.approx(settled(tested), abs=0.1)


def test_too_few_holds_are_refused() -> None:
    with pytest.raises(CalibrationError, match="3 holds, at least 8"):
        OwnSettling(holds=named(holds(7, 3)))
