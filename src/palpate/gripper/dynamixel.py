"""A width-driven gripper on one DYNAMIXEL X-series servo (WidowX 250s and its like).

The servo follows a position and yields at a current (or PWM) limit. Its bus watchdog is set: a
host that falls silent stops the hand. `open_gripper` is what a rig file names for its `[gripper]`.
"""

from __future__ import annotations

import math
from contextlib import suppress

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, InputError
from palpate.gripper import x_series as x
from palpate.gripper.bus_servo import BusServoGripper
from palpate.gripper.fingers import CrankFingers
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.gripper.packets import Register, RegisterRun
from palpate.gripper.servo_line import REPLY_S, RefusedError, ServoLine

#: Fingers of the WidowX 250s: 15 to 37 mm from the middle, each (its robot description).
WIDOWX_LIMITS = GripperLimits(drive="width", lowest=30.0, highest=74.0, fastest=60.0)
#: After a reboot the servo needs this long before it answers (e-Manual: below 0.5 s).
_REBOOT_S, _REBOOT_POLL_S = 2.0, 0.1
#: No servo of these turns faster (rad/s), and readings may have this error (rad): a position that
#: it can't have reached since the last one is another's answer, or a fault of its encoder.
_FASTEST_RAD_PER_S, _SLACK_RAD = 12.0, 0.2


class DynamixelGripper(BusServoGripper):
    """A `Gripper` behind a servo line.

    Parameters
    ----------
    line : ServoLine
        An open line.
    clock : Clock
        For the times of states.
    fingers : CrankFingers
        Angle to width.
    limits : GripperLimits
        Range of the opening and its largest speed.
    current_limit_ma : float
        Current limit at which the servo yields; its force follows from it roughly (friction).
    pwm_limit_percent : float
        The same for servos that measure no current: fraction of the supply.
    watchdog_s : float
        Silence of the host after which the servo stops, 0.02 to 2.54 s.

    Raises
    ------
    InputError
        If a limit is beyond what the servo can do: none is set to another value unasked.
    DeviceError
        If the servo does not answer, is of an unknown kind, turns in reverse, or does not keep
        what it is set to.
    """

    RAD_PER_TICK, RAD_PER_S = x.RAD_PER_TICK, x.RAD_PER_S_PER_VELOCITY
    STATE, POSITION, MOVEMENT = x.STATE, x.PRESENT_POSITION, (x.MOVING_STATUS, x.PROFILE_ONGOING)

    def __init__(
        self,
        line: ServoLine,
        *,
        clock: Clock,
        fingers: CrankFingers,
        limits: GripperLimits = WIDOWX_LIMITS,
        current_limit_ma: float = 500.0,
        pwm_limit_percent: float = 60.0,
        watchdog_s: float = 0.5,
    ) -> None:
        super().__init__(line, clock=clock, fingers=fingers, limits=limits, zero_tick=x.CENTRE_TICK)
        self._current_limit_ma, self._pwm_limit_percent = current_limit_ma, pwm_limit_percent
        self._watchdog = _watchdog_steps(watchdog_s)
        self._last: tuple[float, int] | None = None
        number = line.ping()
        locked = bool(line.alerted)
        if number not in x.MODELS:
            known = ", ".join(model.name for model in x.MODELS.values())
            raise DeviceError(f"{line.name} is of model number {number}; known are {known}")
        self.model = x.MODELS[number]
        if not locked:
            self._set_up()

    def state(self) -> GripperState:
        """Read width, motion and current; current is NaN where the servo measures none.

        Raises `DeviceError` if it does not answer, or a hardware error has switched its torque off.
        """
        run = self._read()
        self._refuse_errors()
        unit = self.model.ma_per_unit
        return GripperState(
            time_s=self._clock.now_s(),
            width_mm=self._width_mm(self._check_reading(run)),
            # A positive current turns towards larger positions (e-Manual, "Present Current"), and
            # those open the fingers: closing reads negative.
            current_ma=math.nan if unit is None else -run.value(x.PRESENT_CURRENT) * unit,
            moving=self._is_on_its_way(run) or bool(run.value(x.MOVING)),
        )

    def stop(self) -> None:
        """Stop a moving servo where it is.

        A new goal at rest would only loosen a grip.

        Raises `DeviceError` if no reading confirms that it stands still; then it is left to its
        watchdog, which is set to its shortest.
        """
        try:
            super().stop()
        except DeviceError:
            with suppress(DeviceError):
                self._line.write_blindly(x.BUS_WATCHDOG, 1)
            raise

    def _start(self, tick: int, *, velocity: int, now: int) -> None:
        self._write_goal(x.PROFILE_VELOCITY, velocity)
        self._write_goal(x.GOAL_POSITION, tick)

    def _hold(self, tick: int) -> None:
        try:
            self._line.write(x.GOAL_POSITION, tick)
        except RefusedError as refused:
            # The watchdog has stopped it already.
            if refused.code != x.PacketError.DATA_RANGE:
                raise

    def clear_errors(self) -> None:
        """Reboot the servo and set it up again.

        The user asks for it after removing the cause.

        Raises `DeviceError` if the error comes back at once, or the servo does not.
        """
        self._line.reboot()
        until_s = self._clock.now_s() + _REBOOT_S
        while True:
            self._clock.sleep_s(_REBOOT_POLL_S)
            try:
                self._line.ping()
                break
            except DeviceError:
                if self._clock.now_s() > until_s:
                    raise
        self._refuse_errors()
        self._set_up()

    def _set_up(self) -> None:
        """Set mode, limits and watchdog, and read them back before the first command."""
        line, unit = self._line, self.model.ma_per_unit
        line.write(x.BUS_WATCHDOG, 0)
        drive_mode = line.read(x.DRIVE_MODE)
        if drive_mode & x.REVERSE:
            raise DeviceError(
                f"{line.name} turns in reverse (DRIVE_MODE {drive_mode}): closing would open. "
                "Clear bit 0 of DRIVE_MODE with DYNAMIXEL Wizard"
            )
        kept = {
            x.DRIVE_MODE: drive_mode & ~x.TIME_BASED,
            x.OPERATING_MODE: x.Mode.POSITION if unit is None else x.Mode.CURRENT_BASED_POSITION,
        }
        if any(line.read(register) != value for register, value in kept.items()):
            # Only where needed: it takes the torque off, and wears the servo's memory.
            line.write(x.TORQUE_ENABLE, 0)
            for register, value in kept.items():
                line.write(register, value)
        volatile = {x.PROFILE_ACCELERATION: 0}
        if unit is None:
            volatile[x.GOAL_PWM] = _within_own(
                "pwm_limit_percent",
                self._pwm_limit_percent,
                x.FULL_PWM / 100.0,
                line.read(x.PWM_LIMIT),
            )
        else:
            volatile[x.GOAL_CURRENT] = _within_own(
                "current_limit_ma", self._current_limit_ma, 1.0 / unit, line.read(x.CURRENT_LIMIT)
            )
        for register, value in volatile.items():
            line.write(register, value)
        line.confirm({**kept, **volatile})
        started = {x.TORQUE_ENABLE: 1, x.BUS_WATCHDOG: self._watchdog}
        for register, value in started.items():
            line.write(register, value)
        line.confirm(started)

    def _write_goal(self, register: Register, value: int) -> None:
        """Write a goal; where the watchdog has stopped the servo meanwhile, arm it again."""
        try:
            self._line.write(register, value)
        except RefusedError as refused:
            if refused.code != x.PacketError.DATA_RANGE or self._line.read(x.BUS_WATCHDOG) >= 0:
                raise
            self._line.write(x.BUS_WATCHDOG, 0)
            self._line.write(x.BUS_WATCHDOG, self._watchdog)
            self._line.write(register, value)

    def _check_reading(self, run: RegisterRun) -> int:
        """Return the position of a reading that the servo can have reached since the last."""
        now_s, tick = self._clock.now_s(), run.value(self.POSITION)
        last, self._last = self._last, (now_s, tick)
        if last is None:
            return tick
        before_s, before = last
        farthest = (_FASTEST_RAD_PER_S * (now_s - before_s) + _SLACK_RAD) / x.RAD_PER_TICK
        if abs(tick - before) > farthest:
            raise DeviceError(
                f"{self._line.name} reports position {tick}, {now_s - before_s:.2f} s after "
                f"{before}: no servo turns so fast. Check its cable, and reply_s in the rig file"
            )
        return tick

    def _refuse_errors(self) -> None:
        """Raise if the servo's last reply reported a hardware error."""
        if self._line.alerted:
            errors = self._line.errors()
            names = ", ".join((error.name or "").lower().replace("_", " ") for error in errors)
            raise DeviceError(
                f"{self._line.name}: {names}; its torque is off until it is rebooted. Take the "
                "cause away, then open it with clear_errors = true in the rig file"
            )


def _watchdog_steps(watchdog_s: float) -> int:
    longest_s = x.LONGEST_WATCHDOG * x.WATCHDOG_STEP_S
    if not x.WATCHDOG_STEP_S <= watchdog_s <= longest_s:
        raise InputError(
            f"watchdog_s {watchdog_s:g}: the servo's watchdog takes {x.WATCHDOG_STEP_S:g} to "
            f"{longest_s:g} s"
        )
    return round(watchdog_s / x.WATCHDOG_STEP_S)


def _within_own(name: str, value: float, units: float, own: int) -> int:
    """Return a limit in the servo's units; refuse one that the servo would not keep."""
    wanted = round(value * units) if math.isfinite(value) else 0
    if not 1 <= wanted <= own:
        raise InputError(
            f"{name} {value:g}: must be above 0 and at most {own / units:g}, the limit in the "
            "servo's own memory"
        )
    return wanted


def open_gripper(
    *,
    port: str,
    servo_id: int = 9,
    baud: int = 1_000_000,
    offset_mm: float = 0.0,
    lowest_mm: float = WIDOWX_LIMITS.lowest,
    highest_mm: float = WIDOWX_LIMITS.highest,
    current_limit_ma: float = 500.0,
    pwm_limit_percent: float = 60.0,
    watchdog_s: float = 0.5,
    reply_s: float = REPLY_S,
    clear_errors: bool = False,
) -> DynamixelGripper:
    """Open the gripper of a WidowX 250s, or one with the same mechanism.

    Parameters
    ----------
    port, servo_id, baud
        Where the servo is.
    offset_mm : float
        Opening between the pads minus that between the carriages (negative with pads on).
    lowest_mm, highest_mm : float
        Range of the opening between the carriages.
    current_limit_ma, pwm_limit_percent, watchdog_s
        As in `DynamixelGripper`.
    reply_s : float
        How long each reply may take, three times over before the servo counts as lost.
    clear_errors : bool
        Reboot a servo that a hardware error has switched off.

    Raises
    ------
    InputError
        If the mechanism can't reach the range, or a limit is beyond what the servo can do.
    DeviceError
        If there is no such port or servo, or it can't be set up.
    """
    fingers = CrankFingers(offset_mm=offset_mm)
    low, high = fingers.reach_mm
    lowest, highest = lowest_mm + offset_mm, highest_mm + offset_mm
    if not low <= lowest < highest <= high:
        raise InputError(
            f"lowest_mm {lowest_mm:g} and highest_mm {highest_mm:g}: the carriages go from "
            f"{low - offset_mm:g} to {high - offset_mm:g} mm"
        )
    line = ServoLine(port, servo_id=servo_id, baud=baud, reply_s=reply_s)
    try:
        gripper = DynamixelGripper(
            line,
            clock=RealClock(),
            fingers=fingers,
            limits=GripperLimits(
                drive="width", lowest=lowest, highest=highest, fastest=WIDOWX_LIMITS.fastest
            ),
            current_limit_ma=current_limit_ma,
            pwm_limit_percent=pwm_limit_percent,
            watchdog_s=watchdog_s,
        )
        if clear_errors and line.errors():
            gripper.clear_errors()
    except (DeviceError, InputError):
        line.close()
        raise
    return gripper
