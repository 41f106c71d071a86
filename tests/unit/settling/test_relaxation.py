"""The relaxation predictor on synthetic holds of many kinds, and on real holds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from palpate.holds import measure_settled_value, read_holds
from palpate.measurement import Status
from palpate.settling.mixture import Mixture, compute_quantiles
from palpate.settling.predict import predict_settled
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate

Array = NDArray[np.float64]


def predict(time_s: Array, values: Array, *, horizon_s: float = 20.0) -> SettledEstimate:
    return Relaxation().predict(time_s, np.atleast_2d(values), horizon_s=horizon_s, level=0.9)


def log_hold(time_s: Array) -> Array:
    return np.asarray(100.0 - 5.0 * np.log(time_s + 0.5))


@pytest.mark.parametrize("rate_hz", [4.8, 15.0, 1000.0])
@pytest.mark.parametrize("cutoff_s", [1.0, 2.5, 12.0])
def test_relaxation_predicts_logarithmic_creep_at_every_sampling_rate(
    rate_hz: float, cutoff_s: float
) -> None:
    time_s = np.arange(0.0, cutoff_s, 1 / rate_hz)
    rng = np.random.default_rng(1)
    values = log_hold(time_s) + rng.normal(0, 0.02, time_s.size)
    estimate = predict(time_s, values).hold(0)
    remaining = log_hold(time_s[-1:])[0] - log_hold(np.array([19.75]))[0]
    # One second of a hold does not determine its later shape.
    assert abs(estimate.value - log_hold(np.array([19.75]))[0]) < 0.6 * remaining
    assert estimate.low < estimate.value < estimate.high
    assert estimate.status is Status.OK


def test_relaxation_ignores_a_large_contact_transient() -> None:
    time_s = np.arange(0.0, 2.5, 1 / 15)
    values = 300.0 + 1000.0 * np.exp(-time_s / 0.1) - 10.0 * np.log(time_s + 0.5)
    settled = 300.0 - 10.0 * np.log(20.25)
    assert predict(time_s, values).hold(0).value == pytest.approx(settled, rel=0.25)


def test_relaxation_of_a_single_reading_is_as_unsure_as_real_materials_are() -> None:
    found = predict_settled([0.1], [412.0])
    assert found.status is Status.TOO_SHORT
    # Food falls by an eighth of its first reading, tape by a third.
    assert found.low < 412.0 * 0.6
    assert found.high > 412.0 * 1.6


@pytest.mark.parametrize(
    ("reading", "half"), [(620.0, 0.5), (3.03, 0.005), (0.25, 0.005), (0.0, 0.5)]
)
def test_relaxation_of_a_constant_hold_is_as_unsure_as_its_last_decimal(
    reading: float, half: float
) -> None:
    estimate = predict(np.arange(0.0, 3.0, 0.1), np.full(30, reading)).hold(0)
    found = estimate.low, estimate.value, estimate.high
    assert found == pytest.approx((reading - half, reading, reading + half))
    assert estimate.status is Status.NOT_SETTLING


def test_relaxation_interval_of_coarse_readings_is_at_least_a_step_wide() -> None:
    time_s = np.arange(0.0, 2.5, 0.05)
    for step in (1.0, 0.25):
        coarse = np.round(log_hold(time_s) / step) * step
        estimate = predict(time_s, coarse).hold(0)
        assert estimate.high - estimate.low >= step


def test_relaxation_of_a_bouncing_hold_is_not_settling_with_a_wide_interval() -> None:
    time_s = np.arange(0.0, 1.5, 0.05)
    calm = log_hold(time_s)
    bouncing = calm + 4.0 * (time_s > 1.0)
    estimates = predict(time_s, np.array([calm, bouncing]))
    width = estimates.high - estimates.low
    assert estimates.hold(0).status is Status.OK
    assert estimates.hold(1).status is Status.NOT_SETTLING
    assert width[1] > 1.5 * width[0]


def test_relaxation_after_the_horizon_returns_the_settled_value() -> None:
    time_s = np.arange(0.0, 25.0, 0.1)
    values = log_hold(time_s)
    estimate = predict(time_s, values).hold(0)
    assert estimate.value == pytest.approx(measure_settled_value(time_s, values, horizon_s=20.0))


def test_relaxation_of_a_batch_equals_single_holds() -> None:
    rng = np.random.default_rng(2)
    time_s = np.arange(0.0, 2.5, 0.1)
    values = log_hold(time_s) + rng.normal(0, 0.5, (700, time_s.size))
    together = predict(time_s, values)
    for index in (0, 255, 256, 699):
        alone = predict(time_s, values[index]).hold(0)
        batched = together.hold(index)
        assert batched.value == pytest.approx(alone.value, rel=1e-12)
        assert batched.high == pytest.approx(alone.high, rel=1e-9)
        assert batched.status is alone.status


def test_relaxation_interval_widens_with_the_level() -> None:
    time_s = np.arange(0.0, 2.5, 0.1)
    values = log_hold(time_s)[None]
    low, high = (
        Relaxation().predict(time_s, values, horizon_s=20.0, level=level) for level in (0.5, 0.95)
    )
    assert high.high[0] > low.high[0]


def test_relaxation_of_a_complete_decay_is_unproven() -> None:
    time_s = np.arange(0.0, 5.0, 0.1)
    rng = np.random.default_rng(6)
    values = 100.0 * (1 + 0.3 * np.exp(-time_s / 1.5)) + rng.normal(0, 0.02, time_s.size)
    assert predict(time_s, values).hold(0).status is Status.UNPROVEN


def test_relaxation_uses_only_the_samples_at_which_the_reading_was_updated() -> None:
    time_s = np.arange(0.0, 5.0, 0.1)
    renewed_s = np.repeat(time_s[::3], 3)[: time_s.size]
    values = log_hold(renewed_s)
    alone = predict(time_s[::3], values[::3]).hold(0)
    assert predict(time_s, values).hold(0).value == alone.value
    batch = predict(time_s, np.stack([log_hold(time_s), values]))
    assert batch.value[0] == predict(time_s, log_hold(time_s)).value[0]
    assert batch.value[1] == alone.value


def score(file: Path, *, cutoff_s: float) -> Array:
    """Return absolute error and half-width in percent, and coverage, for each hold."""
    rows = []
    for hold in read_holds(file):
        settled = measure_settled_value(hold.time_s, hold.values, horizon_s=20.0)
        seen = hold.time_s <= cutoff_s
        estimate = predict(hold.time_s[seen], hold.values[seen]).hold(0)
        rows.append(
            [
                100 * abs(estimate.value / settled - 1),
                50 * (estimate.high - estimate.low) / settled,
                estimate.low <= settled <= estimate.high,
            ]
        )
    return np.array(rows, dtype=np.float64)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cutoff_s", "median_percent", "p90_percent", "half_width_percent"),
    [(1.0, 2.4, 9.0, 9.7), (2.5, 1.3, 4.5, 5.0), (5.0, 0.85, 3.2, 3.2)],
)
def test_relaxation_error_and_coverage_on_real_silicone_holds(
    real_data: Path,
    cutoff_s: float,
    median_percent: float,
    p90_percent: float,
    half_width_percent: float,
) -> None:
    error, half_width, covered = score(real_data / "holds_cbsilicone.csv.gz", cutoff_s=cutoff_s).T
    assert np.median(error) < median_percent
    assert np.quantile(error, 0.9) < p90_percent
    assert error.max() < 50.0
    assert np.median(half_width) < half_width_percent
    assert covered.mean() >= 0.87


@pytest.mark.parametrize("from_ohm", [600.0, 45.0])
def test_relaxation_ignores_an_unloaded_baseline_before_the_hold(from_ohm: float) -> None:
    rng = np.random.default_rng(4)
    time_s = np.arange(0.0, 21.0, 1 / 30)
    held = 40.0 - 1.5 * np.log(time_s + 0.2) + rng.normal(0, 0.02, time_s.size)
    rest = from_ohm + rng.normal(0, 0.2, 45)
    raw_s = np.concatenate([np.arange(45) / 30, time_s + 1.5])
    raw = np.concatenate([rest, held])
    truth = measure_settled_value(time_s, held, horizon_s=20.0)
    seen = raw_s <= 4.0
    found = predict(raw_s[seen], raw[seen], horizon_s=21.5).hold(0)
    assert found.value == pytest.approx(truth, rel=0.04)
    assert 0 < found.low < truth < found.high


def test_relaxation_of_a_relative_change_ignores_the_initial_contact() -> None:
    time_s = np.arange(0.0, 21.0, 1 / 15)
    shape = 1 - 0.5 * np.exp(-time_s / 0.08) + 0.02 * np.log((time_s + 0.3) / 20)
    values = np.where(time_s < 0.1, 0.0, -50.0 * shape)
    truth = measure_settled_value(time_s, values, horizon_s=20.0)
    for cutoff_s, tolerance in ((1.0, 0.05), (2.5, 0.02)):
        seen = time_s <= cutoff_s
        assert predict(time_s[seen], values[seen]).hold(0).value == pytest.approx(
            truth, rel=tolerance
        )


def test_relaxation_one_second_after_a_ringing_contact_is_too_short() -> None:
    time_s = np.arange(0.0, 2.5, 1 / 70)
    ringing = np.exp(-time_s / 0.1) * np.abs(np.cos(25.0 * time_s))
    values = 40.0 * np.exp(ringing - 0.05 * np.log(time_s + 0.2))
    seen = time_s <= 1.0
    assert predict(time_s[seen], values[seen]).hold(0).status is Status.TOO_SHORT
    later = predict(time_s, values).hold(0)
    assert later.status is not Status.TOO_SHORT
    assert later.value == pytest.approx(40.0 * 20.0**-0.05, rel=0.03)


def test_relaxation_follows_a_single_exponential_that_the_samples_prove() -> None:
    time_s = np.arange(0.0, 5.0, 1 / 15)
    rng = np.random.default_rng(8)
    decay = 100.0 * (1 + 0.3 * np.exp(-time_s / 2.0)) + rng.normal(0, 0.02, time_s.size)
    found = predict(time_s, decay).hold(0)
    assert found.value == pytest.approx(100.0, rel=0.005)
    # Real materials continue, so that the interval still reaches towards the log law.
    assert found.low < 97.0


def test_relaxation_follows_a_single_exponential_that_one_second_proves() -> None:
    rng = np.random.default_rng(9)
    time_s = np.arange(0.0, 1.0, 1 / 15)
    tau_s = np.geomspace(0.4, 0.8, 20)[:, None]
    decays = 100.0 * (1 + 0.3 * np.exp(-time_s / tau_s)) + rng.normal(0, 0.02, (20, time_s.size))
    found = predict(time_s, decays)
    assert np.median(np.abs(found.value - 100.0)) < np.median(np.abs(decays[:, -1] - 100.0))


@pytest.mark.parametrize("cutoff_s", [1.0, 2.5, 5.0])
def test_relaxation_intervals_cover_stretched_exponentials(cutoff_s: float) -> None:
    rng = np.random.default_rng(10)
    n_holds = 300
    time_s = np.append(np.arange(0.0, cutoff_s, 1 / 15), 19.75)
    tau_s = np.exp(rng.uniform(np.log(0.7), np.log(20.0), (n_holds, 1)))
    size = np.exp(rng.uniform(np.log(0.05), np.log(0.6), (n_holds, 1)))
    shape = np.exp(-((time_s / tau_s) ** rng.uniform(0.3, 0.8, (n_holds, 1))))
    values = (1 + size * shape) * (1 + rng.normal(0, 5e-4, shape.shape))
    found = predict(time_s[:-1], values[:, :-1])
    covered = (found.low <= values[:, -1]) & (values[:, -1] <= found.high)
    assert covered.mean() >= 0.78


def test_relaxation_interval_widens_beyond_the_proven_horizon() -> None:
    time_s = np.arange(0.0, 10.0, 0.1)
    values = log_hold(time_s)
    near, far, farther = (
        predict(time_s, values, horizon_s=horizon_s).hold(0) for horizon_s in (20.0, 60.0, 1000.0)
    )
    assert near.status is Status.OK
    assert far.status is farther.status is Status.UNPROVEN
    per_fold = [(one.high - one.low) / np.log(one.horizon_s / 10.0) for one in (near, far, farther)]
    assert per_fold == sorted(per_fold)
    assert farther.low < log_hold(np.array([1000.0]))[0] < farther.high


def test_relaxation_of_pure_noise_is_a_misfit() -> None:
    rng = np.random.default_rng(5)
    time_s = np.arange(0.0, 3.0, 1 / 15)
    values = 40.0 * np.exp(rng.normal(0, 0.5, time_s.size))
    assert predict(time_s, values).hold(0).status in (Status.MISFIT, Status.NOT_SETTLING)


def test_quantiles_between_separate_components_are_within_those_of_the_components() -> None:
    """The mirrored mixture has mirrored quantiles."""
    apart = Mixture(
        first=np.array([0]),
        hold=np.array([0, 0]),
        weight=np.array([0.945, 0.055]),
        forecast=np.array([-5.7, -1.6]),
        deviation=np.array([0.25, 0.2]),
        component=np.array([0, 1]),
    )
    log_odds = np.arctanh([[-0.9], [0.0], [0.9]])
    found = compute_quantiles(apart, log_odds)[:, 0]
    assert -6.5 < found[0] < found[1] < found[2] < -1.2
    mirrored = compute_quantiles(apart._replace(forecast=-apart.forecast), log_odds)[:, 0]
    assert mirrored == pytest.approx(-found[::-1], abs=1e-6)
