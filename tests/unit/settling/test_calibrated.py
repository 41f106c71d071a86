"""Settling learned from a sensor's own holds, on invented sheets."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.holds import Hold
from palpate.settling.calibrated import MIN_PROOF_HOLDS, Calibrated
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import FloatArray, Status

TIME_S = np.arange(1, 303) / 15.0


def holds(seed: int, count: int, *, noise: float = 0.03) -> FloatArray:
    """Sheets that gain a fifth late, from 2.5 s to 20 s, against the prior."""
    rng = np.random.default_rng(seed)
    level = -rng.uniform(20, 60, count)[:, None]
    share = 0.3 * np.exp(0.1 * rng.standard_normal(count))[:, None]
    shape = 1.0 - share * np.exp(-((TIME_S / 9.0) ** 1.5))
    return np.asarray(level * shape + noise * rng.standard_normal((count, TIME_S.size)))


def named(values: FloatArray, time_s: FloatArray = TIME_S) -> tuple[Hold, ...]:
    return tuple(
        Hold(hold_id=str(place), channel=None, time_s=time_s, values=row)
        for place, row in enumerate(values)
    )


def settled(values: FloatArray) -> FloatArray:
    return np.asarray(values[:, (TIME_S > 19.5) & (TIME_S <= 20.0)].mean(axis=1))


@pytest.fixture(scope="module")
def own() -> Calibrated:
    return Calibrated(holds=named(holds(1, 20)))


def test_own_holds_beat_the_general_prior(own: Calibrated) -> None:
    tested = holds(2, 20)
    errors = [
        np.abs(predict_settled(TIME_S, tested, cutoff_s=2.5, method=method).value - settled(tested))
        for method in (own, Relaxation())
    ]
    assert np.median(errors[0]) < 0.5 * np.median(errors[1])


def test_intervals_cover_at_their_level(own: Calibrated) -> None:
    tested = holds(3, 60)
    found = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    truth = settled(tested)
    assert 0.85 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 1.0
    assert np.all(found.high - found.low < 0.3 * np.abs(truth))


def test_the_unit_does_not_matter(own: Calibrated) -> None:
    tested = holds(4, 3)
    same = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    scaled = Calibrated(holds=named(7.0 * holds(1, 20)))
    other = predict_settled(TIME_S, 7.0 * tested, cutoff_s=2.5, method=scaled)
    assert other.value == pytest.approx(7.0 * same.value, rel=1e-3)
    assert np.all(other.low < other.high)


def test_at_the_horizon_nothing_is_left_to_learn(own: Calibrated) -> None:
    tested = holds(6, 2)
    found = predict_settled(TIME_S, tested, cutoff_s=20.0, method=own)
    assert found.value == pytest.approx(settled(tested), abs=0.1)


def test_no_holds_are_refused() -> None:
    with pytest.raises(CalibrationError, match="no holds to learn from"):
        Calibrated(holds=())


def test_holds_that_end_too_early_teach_nothing() -> None:
    short = TIME_S < 10.0
    taught = named(holds(7, 5)[:, short], TIME_S[short])
    tested = holds(8, 2)
    found, general = (
        predict_settled(TIME_S, tested, cutoff_s=2.5, method=method)
        for method in (Calibrated(holds=taught), Relaxation())
    )
    assert found.value.tolist() == general.value.tolist()


LONG_S = np.arange(0.0, 20.5, 0.1)


def creeping(count: int, *, seed: int = 10) -> FloatArray:
    """Return values in ohm of holds that all lose the same share, of any size."""
    rng = np.random.default_rng(seed)
    shape = 1.0 - 0.05 * np.log((LONG_S + 1.0) / 21.0)
    size = rng.uniform(100, 900, (count, 1))
    return np.asarray(size * shape * (1 + 2e-4 * rng.standard_normal((count, LONG_S.size))))


def test_more_own_holds_narrow_the_interval() -> None:
    *past, hold = named(creeping(25), LONG_S)
    widths = []
    for count in (3, 6, 12, 24):
        found = predict_settled(hold, method=Calibrated(holds=tuple(past[:count])))
        assert found.low < hold.values[197:201].mean() < found.high
        widths.append(float(found.high - found.low))
    assert widths == sorted(widths, reverse=True)


def test_a_constant_multiple_is_found_where_it_is_true() -> None:
    rng = np.random.default_rng(11)
    # Contact rings in another way each time, and all that follows is one tenth less.
    ringing = 1.0 + rng.uniform(0.1, 0.9, (13, 1)) * np.exp(-LONG_S)
    *past, hold = named(np.where(LONG_S < 10, ringing, 0.9), LONG_S)
    found = predict_settled(hold, cutoff_s=9.0, method=Calibrated(holds=tuple(past)))
    assert found.value == pytest.approx(0.9, rel=0.003)


def test_own_holds_prove_an_interval() -> None:
    rng = np.random.default_rng(12)
    noise = 2e-4 * rng.standard_normal((MIN_PROOF_HOLDS + 1, LONG_S.size))
    *past, hold = named(100 * (1 + 0.3 * np.exp(-LONG_S / 2) + noise), LONG_S)
    assert predict_settled(hold, cutoff_s=5.0).status is Status.UNPROVEN
    few = Calibrated(holds=tuple(past[:-1]))
    assert predict_settled(hold, cutoff_s=5.0, method=few).status is Status.UNPROVEN
    enough = Calibrated(holds=tuple(past))
    assert predict_settled(hold, cutoff_s=5.0, method=enough).status is Status.OK


def test_past_holds_without_a_sample_before_the_cutoff_count_nothing() -> None:
    late = named(creeping(4)[:, 30:], LONG_S[30:])
    [hold] = named(creeping(1, seed=13), LONG_S)
    own = predict_settled(hold, cutoff_s=2.0, method=Calibrated(holds=late))
    assert own.value == predict_settled(hold, cutoff_s=2.0).value
