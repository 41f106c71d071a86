"""A width-controlled gripper on one DYNAMIXEL X-series servo (WidowX 250s and similar).

The servo controls its position and yields at a current (or PWM) limit. Its bus watchdog stops the
gripper if the host falls silent. A rig file refers to `open_gripper` in its `[gripper]` section.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, InputError
from palpate.gripper import x_series as x
from palpate.gripper.bus_servo import BusServoGripper
from palpate.gripper.fingers import CrankFingers
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.gripper.packets import Register, RegisterBlock
from palpate.gripper.servo_line import REPLY_S, RefusedError, ServoLine
from palpate.gripper.settings import check_number

#: WidowX 250s: each finger is 15 to 37 mm from the middle (its robot description).
WIDOWX_LIMITS = GripperLimits(drive="width", lowest=30.0, highest=74.0, fastest=60.0)
#: Time limit for the first answer after a reboot (e-Manual: below 0.5 s), and poll interval.
_REBOOT_S, _REBOOT_POLL_S = 2.0, 0.1
#: Largest shift that the servo can store, in steps.
_MAX_OFFSET = 1_044_479


class DynamixelGripper(BusServoGripper):
    """A `Gripper` on a servo line.

    Parameters
    ----------
    line : ServoLine
        An open line.
    clock : Clock
        Clock that timestamps the states.
    fingers : CrankFingers
        Converts the servo angle to the width.
    limits : GripperLimits
        Range of the opening and its largest speed.
    current_limit_ma : float
        Current at which the servo yields. Because of friction it determines the force only roughly.
    pwm_limit_percent : float
        The corresponding limit for servos without current measurement, percent of the supply.
    watchdog_s : float
        Silence of the host after which the servo stops, 0.02 to 2.54 s.
    homing_offset : int
        The Homing_Offset that is stored in the servo, if a shift of its positions is intended.

    Raises
    ------
    InputError
        If a limit is out of the servo's range. No limit is changed silently.
    DeviceError
        If the servo does not answer, is an unknown model, runs in reverse, does not store its
        settings, or stores settings or stands at a position with which the fingers would not go
        where they are sent.
    """

    RAD_PER_TICK, RAD_PER_S = x.RAD_PER_TICK, x.RAD_PER_S_PER_VELOCITY
    STATE, POSITION, MOVEMENT = x.STATE, x.PRESENT_POSITION, (x.MOVING_STATUS, x.PROFILE_ONGOING)
    TORQUE, TEMPERATURE, GOAL = x.TORQUE_ENABLE, x.PRESENT_TEMPERATURE, x.GOAL_POSITION
    OFFSET, DIRECTION = x.HOMING_OFFSET, x.DRIVE_MODE
    VOLTAGE, VOLTAGE_LIMITS = x.PRESENT_VOLTAGE, (x.MIN_VOLTAGE_LIMIT, x.MAX_VOLTAGE_LIMIT)
    POSITION_LIMITS = x.MIN_POSITION_LIMIT, x.MAX_POSITION_LIMIT
    TOOL = "DYNAMIXEL Wizard"

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
        homing_offset: int = 0,
    ) -> None:
        check_number("homing_offset", homing_offset, low=-_MAX_OFFSET, high=_MAX_OFFSET, whole=True)
        super().__init__(
            line,
            clock=clock,
            fingers=fingers,
            limits=limits,
            zero_tick=x.CENTRE_TICK,
            max_velocity=1,
            homing_offset=homing_offset,
        )
        self._current_limit_ma, self._pwm_limit_percent = current_limit_ma, pwm_limit_percent
        self._watchdog = _watchdog_steps(watchdog_s)
        #: False while an error keeps the servo from being set up.
        self._is_set_up = False
        number = line.ping()
        is_locked = bool(line.alert_bits)
        if number not in x.MODELS:
            known = ", ".join(model.name for model in x.MODELS.values())
            raise DeviceError(
                f"{line.name} has model number {number}, which is not supported; use {known}"
            )
        self.model = x.MODELS[number]
        if not is_locked:
            self._set_up()

    def state(self) -> GripperState:
        """Read width, motion and current; the current is NaN if the servo can't measure it.

        Raises `DeviceError` if the servo does not answer, reports an impossible position or a
        hardware error, or does not move to its goal.
        """
        block = self._read()
        self._raise_reported_error()
        unit, tick = self.model.ma_per_unit, self._take_position(block)
        moving = self._is_moving(block) or bool(block.value(x.MOVING))
        return GripperState(
            time_s=self._clock.now_s(),
            width_mm=self._width_mm(tick),
            # Positive current turns towards larger positions (e-Manual, "Present Current"), which
            # open the fingers. The sign is inverted, so that a closing current is positive.
            current_ma=math.nan if unit is None else -block.value(x.PRESENT_CURRENT) * unit,
            moving=self._follow_movement(block, moving=moving),
        )

    def stop(self) -> None:
        """Stop a moving servo at its current position.

        A servo at rest gets no new goal, because that would loosen the grip.

        Raises `DeviceError` if no reading confirms the stop. The watchdog is then set to its
        shortest time, to stop the servo.
        """
        try:
            super().stop()
        except DeviceError:
            with suppress(DeviceError):
                self._line.write_without_reply(x.BUS_WATCHDOG, 1)
            raise

    def _start_movement(self, tick: int, *, velocity: int, now: int) -> None:
        self._write_goal({x.PROFILE_VELOCITY: velocity, x.GOAL_POSITION: tick})

    def _set_goal(self, tick: int) -> None:
        try:
            self._line.write(x.GOAL_POSITION, tick)
        except RefusedError as refused:
            # After a stop by the watchdog the servo refuses new goals with this code.
            if refused.code != x.PacketError.DATA_RANGE:
                raise

    def _is_stopped_by_silence(self) -> bool:
        return self._line.read(x.BUS_WATCHDOG) < 0

    def clear_errors(self) -> None:
        """Reboot the servo and set it up again.

        Remove the cause of the error first.

        Raises `DeviceError` if the error returns at once or the servo does not answer.
        """
        self._line.reboot()
        deadline_s = self._clock.now_s() + _REBOOT_S
        while True:
            self._clock.sleep_s(_REBOOT_POLL_S)
            try:
                self._line.ping()
                break
            except DeviceError:
                if self._clock.now_s() > deadline_s:
                    raise
        super()._raise_reported_error()
        self._set_up()

    def _set_up(self) -> None:
        """Check the servo as found; set mode, limits and watchdog, and read them back."""
        line, unit = self._line, self.model.ma_per_unit
        self._is_set_up = False
        self._latest = self._movement = None
        self._zero_tick = x.CENTRE_TICK
        # The level is lost with the supply; at a lower one the servo acknowledges no commands.
        line.write_without_reply(x.STATUS_RETURN_LEVEL, x.ALL_REPLIES)
        line.write(x.BUS_WATCHDOG, 0)
        start, end = x.SETTINGS
        stored = line.read_block(start, end - start)
        drive_mode = stored.value(x.DRIVE_MODE)
        if drive_mode & x.REVERSE:
            raise DeviceError(
                f"{line.name} runs in reverse (DRIVE_MODE {drive_mode}): a close command would "
                f"open the gripper. Clear bit 0 of {x.DRIVE_MODE} with {self.TOOL}"
            )
        self._check_offset(stored)
        # The current-based mode ignores these limits. They are checked for it too, because they
        # say how far somebody wanted this servo to turn.
        self._check_position_limits(stored)
        self._check_velocity_limit(stored)
        self._check_travel(_remove_turns(self._read().value(self.POSITION)))
        persistent = {
            x.DRIVE_MODE: drive_mode & ~x.TIME_BASED,
            x.OPERATING_MODE: x.Mode.POSITION if unit is None else x.Mode.CURRENT_BASED_POSITION,
        }
        is_held = bool(stored.value(x.TORQUE_ENABLE))
        if any(stored.value(register) != value for register, value in persistent.items()):
            # Written only if different, because this requires torque off and wears the EEPROM.
            line.write(x.TORQUE_ENABLE, 0)
            is_held = False
            for register, value in persistent.items():
                line.write(register, value)
        volatile = {x.PROFILE_ACCELERATION: 0}
        if unit is None:
            volatile[x.GOAL_PWM] = self._limit_in_units(
                "pwm_limit_percent",
                self._pwm_limit_percent,
                units=x.FULL_PWM / 100.0,
                stored=stored,
                register=x.PWM_LIMIT,
            )
        else:
            volatile[x.GOAL_CURRENT] = self._limit_in_units(
                "current_limit_ma",
                self._current_limit_ma,
                units=1.0 / unit,
                stored=stored,
                register=x.CURRENT_LIMIT,
            )
        for register, value in volatile.items():
            line.write(register, value)
        line.confirm({**persistent, **volatile})
        position = self._find_turn(self._read().value(self.POSITION), stored)
        if not is_held:
            # Replaces an old goal, to which the servo would move as soon as the torque is on.
            line.write(x.GOAL_POSITION, position)
        enabled = {x.TORQUE_ENABLE: 1, x.BUS_WATCHDOG: self._watchdog}
        for register, value in enabled.items():
            line.write(register, value)
        line.confirm(enabled)
        self._is_set_up = True

    def _find_turn(self, position: int, stored: RegisterBlock) -> int:
        """Take the turn in which the servo counts; return the position as a goal.

        The current-based mode counts turns until the supply is switched off. Goals then lie in the
        same turn. This is safe, because the fingers move through less than half a turn: the turn
        is certain once the position is within their travel. In position mode the servo drops the
        turns when its torque is switched on (e-Manual, "Present Position").
        """
        if self.model.ma_per_unit is not None:
            self._zero_tick = x.CENTRE_TICK + position - _remove_turns(position)
            return position
        low, high = map(stored.value, self.POSITION_LIMITS)
        return min(max(_remove_turns(position), low), high)

    def _check_velocity_limit(self, stored: RegisterBlock) -> None:
        """Raise `DeviceError` if the servo is too slow for the gripper's largest rate.

        Only the steepest part of the travel counts: elsewhere the fingers are slower by design.
        """
        limits = self.limits
        slope = self._fingers.max_mm_per_rad(limits.lowest, limits.highest)
        needed = math.ceil(limits.fastest / slope / self.RAD_PER_S)
        self._max_velocity = stored.value(x.VELOCITY_LIMIT)
        if self._max_velocity < needed:
            raise DeviceError(
                f"{self._line.name}: {x.VELOCITY_LIMIT} is {self._max_velocity}, but "
                f"{limits.fastest:g} mm/s need {needed}. Set it to {needed} or more with "
                f"{self.TOOL}"
            )

    def _write_goal(self, values: Mapping[Register, int]) -> None:
        """Write a goal; rearm the watchdog first if it has stopped the servo."""
        try:
            self._line.write_block(values)
        except RefusedError as refused:
            if refused.code != x.PacketError.DATA_RANGE or self._line.read(x.BUS_WATCHDOG) >= 0:
                raise
            self._line.write(x.BUS_WATCHDOG, 0)
            self._line.write(x.BUS_WATCHDOG, self._watchdog)
            self._line.write_block(values)

    def _raise_reported_error(self) -> None:
        super()._raise_reported_error()
        if not self._is_set_up:
            raise DeviceError(
                f"{self._line.name} was restarted after an error, and lost its settings. Open the "
                "rig again"
            )

    def _read_errors(self) -> x.HardwareError:
        return x.HardwareError(self._line.read(x.HARDWARE_ERROR))

    def _describe_recovery(self, *, torque: bool) -> str:
        kept = "The error is reported" if torque else "The torque stays off"
        return (
            f"{kept} until the servo is rebooted: open the gripper with clear_errors = true in the "
            "rig file"
        )

    def _describe_misfit(self, tick: int) -> str:
        return self._describe_wrong_zero()

    def _describe_wrong_zero(self) -> str:
        return (
            f"The horn is mounted at a wrong angle: mount it so that {x.CENTRE_TICK} is the middle "
            f"of the travel, or set {x.HOMING_OFFSET} with {self.TOOL} and give the same "
            "homing_offset in the rig file"
        )


def _remove_turns(tick: int) -> int:
    """Return the position in the turn around the middle of the travel.

    >>> _remove_turns(2048 + 500 + 4096), _remove_turns(2048 - 500 - 8192)
    (2548, 1548)
    """
    half = x.TICKS // 2
    return (tick - x.CENTRE_TICK + half) % x.TICKS - half + x.CENTRE_TICK


def _watchdog_steps(watchdog_s: float) -> int:
    max_s = x.MAX_WATCHDOG_STEPS * x.WATCHDOG_STEP_S
    if not x.WATCHDOG_STEP_S <= watchdog_s <= max_s:
        raise InputError(
            f"watchdog_s {watchdog_s:g}: the servo's watchdog requires {x.WATCHDOG_STEP_S:g} to "
            f"{max_s:g} s"
        )
    return round(watchdog_s / x.WATCHDOG_STEP_S)


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
    homing_offset: int = 0,
    reply_s: float = REPLY_S,
    clear_errors: bool = False,
) -> DynamixelGripper:
    """Open the gripper of a WidowX 250s, or a gripper with the same mechanism.

    Parameters
    ----------
    port, servo_id, baud
        Serial port, number and baud rate of the servo.
    offset_mm : float
        Opening between the pads minus the opening between the carriages; negative with pads.
    lowest_mm, highest_mm : float
        Range of the opening between the carriages.
    current_limit_ma, pwm_limit_percent, watchdog_s, homing_offset
        As in `DynamixelGripper`.
    reply_s : float
        Time limit for each reply. The servo counts as lost after three attempts.
    clear_errors : bool
        Whether to reboot a servo that a hardware error has switched off.

    Raises
    ------
    InputError
        If the range is outside the mechanism's range, or a limit is outside the servo's range.
    DeviceError
        If there is no such port or servo, or the servo can't be set up.
    """
    fingers = CrankFingers(offset_mm=offset_mm)
    low, high = fingers.range_mm
    lowest, highest = lowest_mm + offset_mm, highest_mm + offset_mm
    if not low <= lowest < highest <= high:
        raise InputError(
            f"lowest_mm {lowest_mm:g} and highest_mm {highest_mm:g}: the carriages move from "
            f"{low - offset_mm:g} to {high - offset_mm:g} mm, and lowest_mm is the smaller one"
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
            homing_offset=homing_offset,
        )
        if clear_errors and line.read(x.HARDWARE_ERROR):
            gripper.clear_errors()
    except (DeviceError, InputError):
        line.close()
        raise
    return gripper
