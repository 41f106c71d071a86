"""Calibration of a predictor with a sensor's own holds, on synthetic sheets."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.holds import Hold, measure_settled_value
from palpate.measurement import Status
from palpate.settling.baselines import LogLaw, Recorded
from palpate.settling.calibrated import MIN_PROOF_HOLDS, Calibrated
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import FloatArray, SettlingMethod

TIME_S = np.arange(1, 303) / 15.0


def holds(seed: int, count: int, *, noise: float = 0.03) -> FloatArray:
    """Return holds with a late change of a fifth, contrary to the prior."""
    rng = np.random.default_rng(seed)
    level = -rng.uniform(20, 60, count)[:, None]
    fraction = 0.3 * np.exp(0.1 * rng.standard_normal(count))[:, None]
    shape = 1.0 - fraction * np.exp(-((TIME_S / 9.0) ** 1.5))
    return np.asarray(level * shape + noise * rng.standard_normal((count, TIME_S.size)))


def make_holds(values: FloatArray, time_s: FloatArray = TIME_S) -> tuple[Hold, ...]:
    return tuple(
        Hold(hold_id=str(index), channel=None, time_s=time_s, values=row)
        for index, row in enumerate(values)
    )


def settled_values(values: FloatArray) -> FloatArray:
    return np.asarray(values[:, (TIME_S > 19.5) & (TIME_S <= 20.0)].mean(axis=1))


@pytest.fixture(scope="module")
def own() -> Calibrated:
    return Calibrated(holds=make_holds(holds(1, 20)))


def test_calibrated_with_own_holds_has_half_the_error_of_the_prior(own: Calibrated) -> None:
    tested = holds(2, 20)
    errors = [
        np.abs(
            predict_settled(TIME_S, tested, cutoff_s=2.5, method=method).value
            - settled_values(tested)
        )
        for method in (own, Relaxation())
    ]
    assert np.median(errors[0]) < 0.5 * np.median(errors[1])


def test_calibrated_intervals_have_their_nominal_coverage(own: Calibrated) -> None:
    tested = holds(3, 60)
    found = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    truth = settled_values(tested)
    assert 0.85 <= np.mean((found.low <= truth) & (truth <= found.high)) <= 1.0
    assert np.all(found.high - found.low < 0.3 * np.abs(truth))


def test_calibrated_prediction_scales_with_the_unit(own: Calibrated) -> None:
    tested = holds(4, 3)
    same = predict_settled(TIME_S, tested, cutoff_s=2.5, method=own)
    scaled = Calibrated(holds=make_holds(7.0 * holds(1, 20)))
    other = predict_settled(TIME_S, 7.0 * tested, cutoff_s=2.5, method=scaled)
    assert other.value == pytest.approx(7.0 * same.value, rel=1e-3)
    assert np.all(other.low < other.high)


def test_calibrated_at_the_horizon_returns_the_settled_value(own: Calibrated) -> None:
    tested = holds(6, 2)
    found = predict_settled(TIME_S, tested, cutoff_s=20.0, method=own)
    assert found.value == pytest.approx(settled_values(tested), abs=0.1)


def test_calibrated_without_holds_raises() -> None:
    with pytest.raises(CalibrationError, match="no holds to learn from"):
        Calibrated(holds=())


def test_calibrated_ignores_holds_that_end_before_the_horizon() -> None:
    short = TIME_S < 10.0
    past = make_holds(holds(7, 5)[:, short], TIME_S[short])
    tested = holds(8, 2)
    found, general = (
        predict_settled(TIME_S, tested, cutoff_s=2.5, method=method)
        for method in (Calibrated(holds=past), Relaxation())
    )
    assert found.value.tolist() == general.value.tolist()


LONG_S = np.arange(0.0, 20.5, 0.1)


def creeping_holds(count: int, *, seed: int = 10) -> FloatArray:
    """Return holds in ohm with the same relative fall and different sizes."""
    rng = np.random.default_rng(seed)
    shape = 1.0 - 0.05 * np.log((LONG_S + 1.0) / 21.0)
    size = rng.uniform(100, 900, (count, 1))
    return np.asarray(size * shape * (1 + 2e-4 * rng.standard_normal((count, LONG_S.size))))


def test_calibrated_learns_a_constant_multiple() -> None:
    rng = np.random.default_rng(11)
    # The ringing differs between holds, but the later value is always 0.9.
    ringing = 1.0 + rng.uniform(0.1, 0.9, (13, 1)) * np.exp(-LONG_S)
    *past, hold = make_holds(np.where(LONG_S < 10, ringing, 0.9), LONG_S)
    found = predict_settled(hold, cutoff_s=9.0, method=Calibrated(holds=tuple(past)))
    assert found.value == pytest.approx(0.9, rel=0.003)


def test_calibrated_status_is_ok_with_enough_own_holds() -> None:
    rng = np.random.default_rng(12)
    noise = 2e-4 * rng.standard_normal((MIN_PROOF_HOLDS + 1, LONG_S.size))
    *past, hold = make_holds(100 * (1 + 0.3 * np.exp(-LONG_S / 2) + noise), LONG_S)
    assert predict_settled(hold, cutoff_s=5.0).status is Status.UNPROVEN
    few = Calibrated(holds=tuple(past[:-1]))
    assert predict_settled(hold, cutoff_s=5.0, method=few).status is Status.UNPROVEN
    enough = Calibrated(holds=tuple(past))
    assert predict_settled(hold, cutoff_s=5.0, method=enough).status is Status.OK
    # A status that needs no own holds is not proven by a few.
    *past, creeping = make_holds(creeping_holds(MIN_PROOF_HOLDS + 1), LONG_S)
    assert predict_settled(creeping, cutoff_s=5.0).status is Status.OK
    few = Calibrated(holds=tuple(past[:-1]))
    assert predict_settled(creeping, cutoff_s=5.0, method=few).status is Status.UNPROVEN


@pytest.mark.parametrize("method", [LogLaw(), Recorded()])
def test_calibrated_gives_a_method_without_an_interval_one(method: SettlingMethod) -> None:
    *past, hold = make_holds(creeping_holds(13, seed=14), LONG_S)
    found = predict_settled(hold, cutoff_s=5.0, method=Calibrated(holds=past, method=method))
    truth = measure_settled_value(hold.time_s, hold.values, horizon_s=20.0)
    assert found.low < truth < found.high
    assert found.value == pytest.approx(truth, rel=0.01)


def test_calibrated_ignores_holds_without_samples_before_the_cutoff() -> None:
    late = make_holds(creeping_holds(4)[:, 30:], LONG_S[30:])
    [hold] = make_holds(creeping_holds(1, seed=13), LONG_S)
    own = predict_settled(hold, cutoff_s=2.0, method=Calibrated(holds=late))
    assert own.value == predict_settled(hold, cutoff_s=2.0).value
