"""Simulated sensor, gripper and load cell with the hardware's interfaces and imperfections.

The reported current of a position servo consists of grip torque and gear friction, and depends on
the motor temperature. While the fingers move, gear friction adds to the grip current (closing) or
reduces it (opening). One part of the friction varies between movements; another part varies
periodically along the travel, at the same positions each time. At rest, static friction may have
any value within its band in either direction, depending on the approach to the stop, so it is drawn
for each stop. The torque per ampere falls as the motor warms up.

The friction bands are plausible for the paper's servo (a DYNAMIXEL XM430 draws a few tens of
milliamperes without load) but not measured. The dependence of joint friction on angle and load is
measured (Bittencourt and Gunnarsson 2012, Journal of Dynamic Systems, Measurement and Control 134,
051013); its amount in a small servo, a tenth to a quarter, is a guess.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from palpate.errors import DeviceTimeoutError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.sensor.array import ArrayLayout, Frame
from palpate.twin.ranges import Ranges, draw_uniform, ranges_of
from palpate.twin.stage import ScannedPixels, Stage
from palpate.twin.world import OPEN_MM

#: Rigid: range of the fingers with pads, servo speed, encoder step in mm. Soft: regulator.
_RIGID_LIMITS = GripperLimits(drive="width", lowest=5.0, highest=OPEN_MM, fastest=60.0)
_SOFT_LIMITS = GripperLimits(drive="pressure", lowest=0.0, highest=50.0, fastest=60.0)
_WIDTH_STEP_MM, _PRESSURE_STEP_KPA = 0.05, 0.1
#: Load cell: steps of 1 g, noise of half a step (1 kg cell on an HX711).
_CELL_STEP_N, _CELL_NOISE_N = 0.0098, 0.005

#: Current per newton of grip, its noise, and its resolution.
_MA_PER_N, _NOISE_MA, _STEP_MA = 14.0, 6.0, 2.69
#: Time constant of the motor's warm-up, seconds.
_WARM_S = 900.0
#: Smallest change of the width that counts as movement, mm.
_STILL_MM = 1e-6


class TwinArray:
    """The simulated pressure array.

    Without a queued frame, `read` advances the manual clock to the next frame. Frames are scanned
    at a fixed rate from the opening. As in a serial driver, frames between reads are queued.
    """

    def __init__(self, world: ScannedPixels) -> None:
        self._world = world
        self._queue: deque[Frame] = deque()
        self._start_s = world.clock.now_s()
        self._scanned = 0
        world.watchers.append(self._scan_until)

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the frames."""
        return self._world.layout

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame, advancing the clock to it if necessary."""
        clock = self._world.clock
        if not self._queue:
            wait_s = self._next_s - clock.now_s()
            if wait_s > timeout_s:
                clock.sleep_s(timeout_s)
                raise DeviceTimeoutError(
                    f"no frame from the twin within {timeout_s:g} s (it scans every "
                    f"{1 / self._world.frame_rate_hz:g} s); allow more time"
                )
            clock.sleep_s(max(wait_s, 0.0))
            self._scan_next()
        return self._queue.popleft()

    def skip_until(self, time_s: float) -> None:
        """Advance the clock without scanning, because unread frames need not be computed."""
        clock = self._world.clock
        self._queue.clear()
        passed = int((time_s - self._start_s) * self._world.frame_rate_hz + 1e-9)
        self._scanned = max(self._scanned, passed)
        clock.sleep_s(max(time_s - clock.now_s(), 0.0))

    def close(self) -> None:
        """Stop scanning."""
        if self._scan_until in self._world.watchers:
            self._world.watchers.remove(self._scan_until)

    @property
    def _next_s(self) -> float:
        """Time of the next frame."""
        return self._start_s + (self._scanned + 1) / self._world.frame_rate_hz

    def _scan_until(self, time_s: float) -> None:
        """Scan every due frame before the world advances to `time_s`."""
        while self._next_s <= time_s:
            self._scan_next()

    def _scan_next(self) -> None:
        time_s = self._next_s
        frame = Frame(
            time_s=time_s,
            sequence=self._scanned,
            counts=self._world.scan(time_s),
            oversampling=self._world.oversampling,
        )
        self._scanned += 1
        self._queue.append(frame)


class TwinGripper:
    """The simulated gripper: rigid fingers driven by a servo, or soft fingers by pressure."""

    def __init__(self, world: Stage) -> None:
        self._world = world
        self._noise = np.random.default_rng([world.seed, 4])
        self._current = ServoCurrent(
            ranges_of(world.level),
            servo_seed=world.sheet_seed,
            session_seed=world.seed,
            start_s=world.now_s(),
        )

    @property
    def limits(self) -> GripperLimits:
        """Range and drive."""
        return _RIGID_LIMITS if self._world.gripper == "rigid" else _SOFT_LIMITS

    def state(self) -> GripperState:
        """Return width and current as reported by the servo, or the pressure of soft fingers."""
        now_s = self._world.now_s()
        value, moving = self._world.drive_value(now_s), self._world.is_moving(now_s)
        if self._world.gripper == "soft":
            pressure = value + 0.1 * float(self._noise.standard_normal())
            rounded = round(pressure / _PRESSURE_STEP_KPA) * _PRESSURE_STEP_KPA
            return GripperState(time_s=now_s, pressure_kpa=max(rounded, 0.0), moving=moving)
        current_ma = self._current.read_ma(
            now_s, force_n=self._world.force_n(now_s), width_mm=value, moving=moving
        )
        return GripperState(
            time_s=now_s,
            width_mm=round(value / _WIDTH_STEP_MM) * _WIDTH_STEP_MM,
            current_ma=current_ma,
            moving=moving,
        )

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a command, clamped to the limits; return the command sent."""
        limits = self.limits
        # Targets are rounded to the step of the servo's encoder or the regulator's converter.
        step = _WIDTH_STEP_MM if limits.drive == "width" else _PRESSURE_STEP_KPA
        target = round(wanted.target / step) * step
        sent = limits.clamp(GripperCommand(target=target, rate=max(wanted.rate, 0.01)))
        self._world.drive(sent.target, rate=sent.rate)
        return sent

    def stop(self) -> None:
        """Stop the fingers and hold their position."""
        self._world.halt()

    def release(self) -> None:
        """Open fully, or vent."""
        self._world.drive(self.limits.target(0.0), rate=self.limits.fastest)

    def close(self) -> None:
        """Do nothing, as there is no device."""


class TwinLoadCell:
    """A simulated load cell: grip force in 1 g steps, with noise."""

    def __init__(self, world: Stage) -> None:
        self._world = world
        self._noise = np.random.default_rng([world.seed, 5])

    def read_n(self) -> float:
        """Return the present force, newtons."""
        force_n = self._world.force_n(self._world.now_s())
        noisy = force_n + _CELL_NOISE_N * float(self._noise.standard_normal())
        return round(noisy / _CELL_STEP_N) * _CELL_STEP_N


class ServoCurrent:
    """The current of one servo in one session.

    `ranges`: ranges of the gear and temperature parameters.
    `servo_seed`, `session_seed`: seeds of the servo's constant properties, and of its properties
        in this session.
    `start_s`: time at which the servo was switched on.
    """

    def __init__(
        self, ranges: Ranges, *, servo_seed: int, session_seed: int, start_s: float
    ) -> None:
        gears = np.random.default_rng([servo_seed, 6])
        self._gear_ma = draw_uniform(gears, ranges.servo_friction_ma)
        self._gear_fraction = draw_uniform(gears, ranges.servo_friction_fraction)
        self._ripple = draw_uniform(gears, ranges.servo_friction_ripple)
        self._period_mm = draw_uniform(gears, ranges.servo_friction_period_mm)
        self._phase = draw_uniform(gears, (0.0, math.tau))
        self._movement_sd = draw_uniform(gears, ranges.servo_friction_movement_sd)
        self._rng = np.random.default_rng([session_seed, 4])
        self._cold_offset = draw_uniform(self._rng, ranges.servo_warm_fraction)
        self._warming = draw_uniform(self._rng, ranges.servo_warm_fraction)
        # A separate stream preserves the other draws of a seed.
        self._movements = self._rng.spawn(1)[0]
        self._start_s = start_s
        self._width_mm = math.nan
        self._direction = 0
        self._movement = 1.0
        self._friction_level = 0.0

    def read_ma(self, time_s: float, *, force_n: float, width_mm: float, moving: bool) -> float:
        """Return the reported current; positive means closing."""
        self._update_motion(width_mm, moving=moving)
        warm = self._cold_offset - self._warming * math.expm1(-(time_s - self._start_s) / _WARM_S)
        grip_ma = _MA_PER_N * force_n * (1.0 + warm)
        friction_ma = self._gear_fraction * grip_ma + self._gear_ma
        read_ma = grip_ma + self._friction_level * friction_ma
        read_ma += _NOISE_MA * float(self._rng.standard_normal())
        return round(read_ma / _STEP_MA) * _STEP_MA

    def _update_motion(self, width_mm: float, *, moving: bool) -> None:
        """Update direction and friction: +1 closing, -1 opening, a random value at rest."""
        travel_mm, self._width_mm = width_mm - self._width_mm, width_mm
        if not abs(travel_mm) > _STILL_MM:
            return
        if not moving:
            self._direction, self._friction_level = 0, float(self._rng.uniform(-1, 1))
            return
        direction = -1 if travel_mm > 0 else 1
        if direction != self._direction:
            self._direction = direction
            scatter = self._movement_sd * float(self._movements.standard_normal())
            self._movement = math.exp(scatter)
        turned = math.tau * width_mm / self._period_mm + self._phase
        self._friction_level = direction * self._movement * (1.0 + self._ripple * math.sin(turned))
