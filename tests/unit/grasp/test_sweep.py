"""Detection of contact during a sweep."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.force.servo_force import CurrentLaw, GearFriction
from palpate.grasp.sweep import Sweep

RATE_HZ, NOISE, SPIKE = 15.0, 0.001, 0.05


def first_touch_s(
    change: dict[int, float],
    *,
    begins_s: float,
    seed: int = 0,
    noise: float = NOISE,
    slowed: bool = False,
) -> float | None:
    """Return the contact time in a 3 s approach; some pixels `change` per second."""
    rng = np.random.default_rng(seed)
    sweep = Sweep(rate=10.0, end=60.0, since_s=0.0, slowed=slowed)
    for index in range(int(3.0 * RATE_HZ)):
        time_s = (index + 1) / RATE_HZ
        before = 2.0 * SPIKE if slowed else 0.0
        spike = SPIKE + (before - SPIKE) * np.exp(-time_s / 0.1)
        log_ohm = spike + noise * rng.standard_normal((4, 2))
        for pixel, per_s in change.items():
            log_ohm.flat[pixel] += per_s * max(time_s - begins_s, 0.0)
        sweep = sweep.with_frame(time_s, log_ohm=log_ohm, gears_ma=float("nan"))
        if sweep.is_touching(None):
            return time_s
    return None


@pytest.mark.parametrize(("noise", "slowed"), [(NOISE, False), (0.005, False), (NOISE, True)])
def test_sweep_rise_noise_or_slowing_of_a_movement_is_not_contact(
    noise: float, slowed: bool
) -> None:
    """Single noisy frames fall further than the slow falls of a contact."""
    for seed in range(20):
        assert first_touch_s({}, begins_s=0.0, seed=seed, noise=noise, slowed=slowed) is None


@pytest.mark.parametrize(
    ("pixels", "per_s", "begins_s", "noise", "slowed", "within_s"),
    [
        (1, -0.2, 0.3, NOISE, False, 0.5),
        (8, -0.2, 0.3, NOISE, False, 0.5),
        (1, -0.2, 1.5, NOISE, False, 0.5),
        (8, -0.2, 1.5, NOISE, False, 0.5),
        # The recent readings rise too, so only the movement's level shows a slowly rising load.
        (8, -0.015, 1.0, NOISE, False, 1.5),
        # A hard contact is detected while slowing down.
        (1, -2.0, 0.1, NOISE, True, 0.3),
        (1, -2.0, 0.1, 0.005, True, 0.3),
        # The disturbance of the faster movement has decayed after 0.25 s.
        (1, -0.5, 0.6, NOISE, True, 0.2),
    ],
)
def test_sweep_fall_of_one_or_all_pixels_is_contact(
    pixels: int, per_s: float, begins_s: float, noise: float, slowed: bool, within_s: float
) -> None:
    change = dict.fromkeys([3] if pixels == 1 else range(8), per_s)
    found = first_touch_s(change, begins_s=begins_s, noise=noise, slowed=slowed)
    assert 0.0 < found - begins_s < within_s


def test_sweep_detects_repeated_frames_within_a_third_of_a_second() -> None:
    """Earlier changes do not delay the detection."""
    rng, sweep = np.random.default_rng(3), Sweep(rate=10.0, end=60.0, since_s=0.0)
    frozen = NOISE * rng.standard_normal((4, 2))
    for index in range(12):
        log_ohm = NOISE * rng.standard_normal((4, 2)) if index < 8 else frozen
        sweep = sweep.with_frame((index + 1) / RATE_HZ, log_ohm=log_ohm, gears_ma=float("nan"))
        assert sweep.is_frozen == (index >= 11)


@pytest.mark.parametrize(("more_ma", "felt"), [(0.0, False), (33.0, False), (41.0, True)])
def test_sweep_detects_contact_by_servo_current(more_ma: float, felt: bool) -> None:
    """Limits are 4.5 deviations of noise (6 mA) and 15 % of friction (54 mA)."""
    gears = GearFriction(mean_ma=54.0, mean_sd_ma=1.0, movement_ma=4.0)
    current = CurrentLaw(gears=gears, ma_per_n=16.0, noise_ma=6.0)
    rng, sweep = np.random.default_rng(4), Sweep(rate=10.0, end=60.0, since_s=0.0)
    for index in range(16):
        pull_ma = more_ma if index == 15 else 0.0
        log_ohm = NOISE * rng.standard_normal((4, 2))
        sweep = sweep.with_frame((index + 1) / RATE_HZ, log_ohm=log_ohm, gears_ma=pull_ma)
        assert not sweep.is_touching(None)
    assert sweep.is_touching(current) is felt
