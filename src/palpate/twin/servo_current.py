"""What a position servo reports as current: grip torque, gear friction and the warmth of its motor.

While the fingers move, friction of the gears adds to the grip (closing) or takes from it (opening).
It is never twice the same: it has a share of its own for each movement (how the teeth and the
grease lie), and rises and falls along the way, as the gears turn, in the same places each time.
At rest it may hold any part of itself either way: where in that band a stop ends depends on how
the position controller came in, so it is drawn anew for each stop. The torque of an ampere falls
as the motor warms up.

The size of the bands is plausible for the paper's servo (a DYNAMIXEL XM430 takes some tens of
milliamperes to turn without load), not measured. That friction of a robot's joint changes with its
angle and its load is (Bittencourt and Gunnarsson 2012, Journal of Dynamic Systems, Measurement and
Control 134, 051013); by how much it does in a small servo, a tenth to a quarter, is a guess.
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
        self._along = uniform(gears, ranges.servo_friction_along)
        self._period_mm = uniform(gears, ranges.servo_friction_period_mm)
        self._phase = uniform(gears, (0.0, math.tau))
        self._movement_sd = uniform(gears, ranges.servo_friction_movement_sd)
        self._rng = np.random.default_rng([session_seed, 4])
        self._cold = uniform(self._rng, ranges.servo_warm_share)
        self._warmer = uniform(self._rng, ranges.servo_warm_share)
        # A stream of its own, which leaves the other draws of a seed as they are without it.
        self._movements = self._rng.spawn(1)[0]
        self._start_s = start_s
        self._width_mm = math.nan
        self._way = 0
        self._movement = 1.0
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
        if not moving:
            self._way, self._stuck = 0, float(self._rng.uniform(-1, 1))
            return
        way = -1 if way_mm > 0 else 1
        if way != self._way:
            self._way = way
            scatter = self._movement_sd * float(self._movements.standard_normal())
            self._movement = math.exp(scatter)
        turned = math.tau * width_mm / self._period_mm + self._phase
        self._stuck = way * self._movement * (1.0 + self._along * math.sin(turned))
