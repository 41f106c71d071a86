"""What a position servo reports as current: grip torque, gear friction and the warmth of its motor.

While the fingers move, friction of the gears adds to the grip (closing) or takes from it (opening).
At rest it may hold any part of itself either way: where in that band a stop ends depends on how
the position controller came in, so it is drawn anew for each stop. The torque of an ampere falls
as the motor warms up.

The size of the bands is plausible for the paper's servo (a DYNAMIXEL XM430 takes some tens of
milliamperes to turn without load), not measured.
"""

from __future__ import annotations

import math

import numpy as np

from palpate.twin.ranges import Ranges, uniform

#: Current per newton of grip, its scatter from reading to reading, and its steps.
_MA_PER_N, _NOISE_MA, _STEP_MA = 14.0, 6.0, 2.69
#: How long a motor takes to reach its working temperature, seconds.
_WARM_S = 900.0
#: Nearer than this to the last reading the fingers have not moved, mm.
_STILL_MM = 1e-6


class ServoCurrent:
    """The current of one servo in one session.

    Parameters
    ----------
    ranges : Ranges
        What gears and warmth are drawn from.
    servo_seed, session_seed : int
        Of what stays with the servo, and of what changes from session to session.
    start_s : float
        When the servo was switched on.
    """

    def __init__(
        self, ranges: Ranges, *, servo_seed: int, session_seed: int, start_s: float
    ) -> None:
        gears = np.random.default_rng([servo_seed, 6])
        self._gear_ma = uniform(gears, ranges.servo_friction_ma)
        self._gear_share = uniform(gears, ranges.servo_friction_share)
        self._rng = np.random.default_rng([session_seed, 4])
        self._cold = uniform(self._rng, ranges.servo_warm_share)
        self._warmer = uniform(self._rng, ranges.servo_warm_share)
        self._start_s = start_s
        self._width_mm = math.nan
        self._stuck = 0.0

    def read_ma(self, time_s: float, *, force_n: float, width_mm: float, moving: bool) -> float:
        """Return what the servo reports, with the sign of closing."""
        self._turn(width_mm, moving=moving)
        warm = self._cold - self._warmer * math.expm1(-(time_s - self._start_s) / _WARM_S)
        grip_ma = _MA_PER_N * force_n * (1.0 + warm)
        friction_ma = self._gear_share * grip_ma + self._gear_ma
        read_ma = grip_ma + self._stuck * friction_ma
        read_ma += _NOISE_MA * float(self._rng.standard_normal())
        return round(read_ma / _STEP_MA) * _STEP_MA

    def _turn(self, width_mm: float, *, moving: bool) -> None:
        """Note which way the fingers go: +1 closing, -1 opening, in between at rest."""
        way_mm, self._width_mm = width_mm - self._width_mm, width_mm
        if not abs(way_mm) > _STILL_MM:
            return
        self._stuck = -math.copysign(1.0, way_mm) if moving else float(self._rng.uniform(-1, 1))
