"""A law for a new sensor: between what its kind teaches and what its own weights say."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.population_law import PopulationForceLaw

LOADS_N = np.geomspace(0.5, 10, 12)


def sensor(seed: int) -> np.ndarray:
    """Return the excess conductances of a sensor of the kind, siemens."""
    rng = np.random.default_rng(seed)
    log_force = np.log(LOADS_N) + rng.normal(0, 0.3, 12)
    exponent = rng.normal(0.9, 0.2)
    gain = rng.normal(1.0, 0.4)
    return np.exp((log_force - gain) / exponent - 3.0)


@pytest.fixture(scope="module")
def kind() -> PopulationForceLaw:
    """Return the law of six sensors."""
    return PopulationForceLaw.fit([sensor(k) for k in range(6)], forces_n=[LOADS_N] * 6)


def test_without_weights_a_sensor_is_the_mean_of_its_kind(kind: PopulationForceLaw) -> None:
    law = kind.calibrate([], force_n=[])
    assert (law.gain, law.exponent) == pytest.approx((kind.gain, kind.exponent))


def test_many_weights_outweigh_the_kind(kind: PopulationForceLaw) -> None:
    excess = np.tile(np.geomspace(0.01, 1.0, 20), 40)
    law = kind.calibrate(excess, force_n=30 * excess**1.4)
    assert law.exponent == pytest.approx(1.4, abs=0.02)


def test_more_weights_narrow_the_interval(kind: PopulationForceLaw) -> None:
    widths = []
    for count in (0, 3, 12):
        answer = kind.calibrate(sensor(50)[:count], force_n=LOADS_N[:count]).force_n([0.3])
        widths.append(float((answer.high / answer.low)[0]))
    assert widths[0] > widths[1] > widths[2]


def test_intervals_cover_new_sensors(kind: PopulationForceLaw) -> None:
    inside = []
    for seed in range(100, 200):
        excess = sensor(seed)
        answer = kind.calibrate(excess[:3], force_n=LOADS_N[:3]).force_n(excess[3:])
        inside.append((answer.low <= LOADS_N[3:]) & (LOADS_N[3:] <= answer.high))
    assert 0.85 <= np.mean(inside) <= 0.98


def test_readings_beyond_the_kind_are_flagged(kind: PopulationForceLaw) -> None:
    answer = kind.calibrate([], force_n=[]).force_n([kind.range[0] / 2, kind.range[1]])
    assert answer.in_range.tolist() == [False, True]


def test_too_little_to_learn_from_is_refused() -> None:
    with pytest.raises(CalibrationError, match="no sensor"):
        PopulationForceLaw.fit([], forces_n=[])
    with pytest.raises(CalibrationError, match="4 loaded steps"):
        PopulationForceLaw.fit([[1.0, 2, 3, 4]], forces_n=[[1.0, 2, 3, 4]])
