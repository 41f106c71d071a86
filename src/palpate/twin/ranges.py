"""All ranges of the twin's random draws, by level.

`lab` has the variation of the paper's Tables 2 to 6, but lacks some entries of Tables 1, 4 and 5
(the studies count them). `field` has the variation of real Velostat outside one laboratory's
careful setup (`palpate study realism`):

- force exponents with the spread of three sensors under dead weights (0.8 to 1.6, a standard
  deviation of 0.4), and conductances up to 150-260 times the rest value;
- gain between positions with a log standard deviation of 0.6 (robot presses against a load cell);
- resistances still 10-20 % from settled 2.5 s after the fingers stop (weights on Velostat), and an
  exponential fit that misses most of the remaining change;
- noise of a tenth to a few tenths of a percent.

The rest values of `field` suit the twin's reference resistor of 4.7 kohm, as if `palpate doctor`
had chosen the resistor. Environment, wear and suction are plausible at both levels but not
measured, because the paper's Figures 1b, 3 and 4 print no numbers.

A pair (low, high) is drawn uniformly, or log-uniformly if the name ends in `_log`. A single
`..._sd` is a standard deviation, of the logarithm if stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

Level: TypeAlias = Literal["lab", "field"]
Pair: TypeAlias = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ranges:
    """Ranges of one level, `lab` by default, grouped by component."""

    # Sheet at rest.
    rest_ohm_log: Pair = (7e3, 20e3)
    rest_pixel_log_sd: float = 0.12
    # Static law of one pixel: gain * ((F - threshold) / unit_force) ** exponent, saturating.
    unit_force_n_log: Pair = (1.3, 2.1)
    exponent: Pair = (1.15, 1.55)
    threshold_n: Pair = (0.05, 0.2)
    saturation_log: Pair = (40.0, 150.0)
    sheet_pixel_log_sd: float = 0.12
    place_common_log_sd: float = 0.04
    place_pixel_log_sd: float = 0.08
    # Hysteresis: relative fall of the force before the sheet follows.
    hysteresis: Pair = (0.03, 0.10)
    # Creep families (repetition increases the probability), and the ranges of each family.
    families: tuple[str, ...] = ("two-mode", "slow-power", "hetero")
    two_mode_scale: Pair = (1.0, 1.0)
    slow_power_fraction: Pair = (0.45, 0.75)
    slow_power_exponent: Pair = (0.25, 0.55)
    slow_power_start_s_log: Pair = (0.1, 0.4)
    hetero_fraction: Pair = (0.30, 0.50)
    hetero_time_s_log: Pair = (0.4, 25.0)
    creep_place_log_sd: float = 0.15
    # Resistance spike on each movement of a finger.
    spike_decay_s: Pair = (0.06, 0.12)
    spike_per_mm: Pair = (0.03, 0.08)
    spike_per_target: Pair = (0.4, 0.8)
    # Noise of one pixel, as a fraction of its resistance; converter noise in counts.
    white_noise: Pair = (0.0005, 0.0012)
    slow_noise: Pair = (0.0003, 0.0010)
    adc_noise_counts: float = 0.3
    # Gripper.
    finger_mm_per_n: Pair = (0.17, 0.26)
    pad_travel_mm: Pair = (0.15, 0.45)
    pad_force_n: Pair = (1.5, 4.0)
    width_repeat_sd_mm: float = 0.02
    off_centre: float = 0.6
    # Offset of the object from the middle between the fingers, and backlash of rails and gears.
    off_middle_mm: Pair = (0.0, 1.0)
    backlash_mm: Pair = (0.03, 0.12)
    # Servo current: gear friction in mA and as a fraction of the grip current, its relative ripple
    # along the travel, and its variation between movements (sd of the logarithm); change of the
    # torque per ampere between sessions and during warm-up.
    servo_friction_ma: Pair = (20.0, 60.0)
    servo_friction_fraction: Pair = (0.05, 0.25)
    servo_friction_ripple: Pair = (0.05, 0.15)
    servo_friction_period_mm: Pair = (3.0, 20.0)
    servo_friction_movement_sd: Pair = (0.05, 0.15)
    servo_warm_fraction: Pair = (-0.06, 0.02)
    # Environment and wear.
    rest_per_kelvin: Pair = (-0.012, -0.004)
    rest_per_humidity_percent: Pair = (-0.004, 0.001)
    gain_per_kelvin: Pair = (-0.006, 0.006)
    gain_per_humidity_percent: Pair = (-0.002, 0.002)
    break_in: Pair = (0.1, 0.4)
    break_in_cycles_log: Pair = (100.0, 600.0)
    rest_break_in: Pair = (-0.1, 0.1)
    rest_per_1000_cycles: Pair = (-0.03, 0.03)
    gain_per_1000_cycles: Pair = (-0.03, 0.03)
    # Suction: largest fraction of the rest conductance that it removes, and its pressure scale.
    lift_fraction: Pair = (0.1, 0.5)
    lift_kpa_log: Pair = (5.0, 30.0)


LAB = Ranges()
FIELD = replace(
    LAB,
    rest_ohm_log=(2e3, 20e3),
    rest_pixel_log_sd=0.35,
    unit_force_n_log=(0.03, 0.8),
    exponent=(0.5, 2.0),
    threshold_n=(0.0, 0.1),
    saturation_log=(150.0, 800.0),
    sheet_pixel_log_sd=0.4,
    place_common_log_sd=0.3,
    place_pixel_log_sd=0.6,
    hysteresis=(0.05, 0.30),
    # With weights on Velostat and stretched silicone, an exponential fit misses most of the
    # remaining change; with `two-mode`, the paper's own sensor, it predicts more than half.
    families=("two-mode", *4 * ("slow-power", "hetero")),
    two_mode_scale=(0.08, 0.4),
    slow_power_fraction=(0.15, 0.45),
    slow_power_exponent=(0.10, 0.60),
    slow_power_start_s_log=(0.05, 1.0),
    hetero_fraction=(0.15, 0.45),
    hetero_time_s_log=(0.5, 200.0),
    creep_place_log_sd=0.35,
    white_noise=(0.001, 0.004),
    slow_noise=(0.001, 0.004),
    width_repeat_sd_mm=0.04,
    off_middle_mm=(0.0, 2.5),
    backlash_mm=(0.05, 0.3),
    servo_friction_ripple=(0.1, 0.25),
    servo_friction_movement_sd=(0.1, 0.25),
    rest_per_kelvin=(-0.025, -0.004),
    rest_per_humidity_percent=(-0.008, 0.002),
    gain_per_kelvin=(-0.015, 0.015),
    gain_per_humidity_percent=(-0.004, 0.004),
    rest_break_in=(-0.25, 0.25),
    rest_per_1000_cycles=(-0.08, 0.08),
    gain_per_1000_cycles=(-0.08, 0.08),
)

LEVELS: dict[str, Ranges] = {"lab": LAB, "field": FIELD}


def ranges_of(level: str) -> Ranges:
    """Return the ranges of the twin's random draws at a level (`lab` or `field`).

    Raises `ValueError` for an unknown level.
    """
    if level not in LEVELS:
        raise ValueError(f"no twin level {level!r}; available: {', '.join(LEVELS)}")
    return LEVELS[level]


def draw_uniform(rng: np.random.Generator, bounds: Pair) -> float:
    """Draw a number uniformly between two bounds."""
    return float(rng.uniform(*bounds))


def draw_log_uniform(rng: np.random.Generator, bounds: Pair) -> float:
    """Draw a number log-uniformly between two bounds."""
    return float(np.exp(rng.uniform(np.log(bounds[0]), np.log(bounds[1]))))
