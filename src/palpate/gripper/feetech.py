"""A gripper on one Feetech STS3215 bus servo: one moving and one fixed jaw (SO-101).

The servo controls its position and yields at a torque limit. It has no watchdog. During closing,
its goal is at most the travel of `leash_s` ahead, and the servo stops there if the host falls
silent. A rig file refers to `open_gripper` in its `[gripper]` section.
"""

from __future__ import annotations

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, InputError
from palpate.gripper import sts_series as sts
from palpate.gripper.bus_servo import BusServoGripper
from palpate.gripper.fingers import HingedJaw
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.gripper.packets import PROTOCOL_1, RegisterBlock
from palpate.gripper.servo_line import REPLY_S, ServoLine
from palpate.gripper.settings import check_number

#: Maximum speed of the jaw. The servo takes about a second for half a turn.
_FASTEST_MM_PER_S = 60.0
#: Part of the leash after which a further goal is sent.
_LEASH_STEP = 0.25
#: Largest shift that the servo can store, in steps.
_MAX_OFFSET = 2047


class FeetechGripper(BusServoGripper):
    """A `Gripper` driven by a Feetech bus servo.

    Parameters
    ----------
    line : ServoLine
        An open line, Protocol 1.
    clock : Clock
        Clock that timestamps the states.
    jaw : HingedJaw
        Converts the servo angle to the width.
    limits : GripperLimits
        Range of the opening and its largest speed.
    closed_tick : int
        Position, 0 to 4095, at which the pads touch.
    opens : {1, -1}
        1 if positions increase as the jaw opens, -1 if they decrease.
    torque_limit_percent : float
        Torque at which the servo yields, percent of its maximum.
    leash_s : float
        Longest closing time without a message from the host.
    homing_offset : int
        The Homing_Offset that was stored in the servo when `closed_tick` was read.

    Raises
    ------
    InputError
        If a number is out of range.
    DeviceError
        If the servo does not answer, is an unknown model, is in another mode, is in a protection
        state, or stores settings or stands at a position with which the jaw would not go where it
        is sent.
    """

    RAD_PER_TICK = RAD_PER_S = sts.RAD_PER_TICK
    STATE, POSITION, MOVEMENT = sts.STATE, sts.PRESENT_POSITION, (sts.MOVING, 1)
    TORQUE, TEMPERATURE, GOAL = sts.TORQUE_ENABLE, sts.PRESENT_TEMPERATURE, sts.GOAL_POSITION
    OFFSET, DIRECTION = sts.HOMING_OFFSET, sts.PHASE
    VOLTAGE, VOLTAGE_LIMITS = sts.PRESENT_VOLTAGE, (sts.MIN_VOLTAGE_LIMIT, sts.MAX_VOLTAGE_LIMIT)
    POSITION_LIMITS = sts.MIN_POSITION_LIMIT, sts.MAX_POSITION_LIMIT
    TOOL = "Feetech's program FD"

    def __init__(
        self,
        line: ServoLine,
        *,
        clock: Clock,
        jaw: HingedJaw,
        limits: GripperLimits,
        closed_tick: int,
        opens: int = 1,
        torque_limit_percent: float = 30.0,
        leash_s: float = 0.5,
        homing_offset: int = 0,
    ) -> None:
        if opens not in (1, -1):
            raise InputError(
                f"opens {opens!r}: give 1 if positions increase as the jaw opens, otherwise -1"
            )
        check_number("closed_tick", closed_tick, low=0, high=sts.TICKS - 1, whole=True)
        check_number("torque_limit_percent", torque_limit_percent, low=1.0, high=100.0, unit="%")
        check_number("leash_s", leash_s, low=0.05, high=2.0, unit="s")
        check_number("homing_offset", homing_offset, low=-_MAX_OFFSET, high=_MAX_OFFSET, whole=True)
        super().__init__(
            line,
            clock=clock,
            fingers=jaw,
            limits=limits,
            zero_tick=closed_tick,
            max_velocity=sts.MAX_VELOCITY,
            opens=opens,
            homing_offset=homing_offset,
        )
        self._leash_s = leash_s
        low, high = self._goal_ticks()
        if low < 0 or high >= sts.TICKS:
            raise InputError(
                f"closed_tick {closed_tick}: the jaw needs positions {low} to {high}, "
                f"but the servo has 0 to {sts.TICKS - 1}; remount its horn"
            )
        self._target = self._sent = self._velocity = 0
        self._was_still = True
        self._set_up(torque_limit_percent)

    def state(self) -> GripperState:
        """Read width, motion and current; during a long closing, send the next goal.

        Raises `DeviceError` if the servo does not answer, reports an impossible position or a
        protection state, or does not move to its goal.
        """
        block = self._read()
        self._raise_reported_error()
        tick, is_turning = self._take_position(block), self._is_moving(block)
        is_leashed = self._sent != self._target
        # A servo at rest in two successive readings, short of its target, is blocked.
        moving = is_turning or (is_leashed and not self._was_still)
        self._was_still = not is_turning
        moving = self._follow_movement(block, moving=moving)
        if is_leashed:
            goal = self._apply_leash(tick)
            # A goal for each small step would double the time of a state on a slow line.
            step = self._velocity * self._leash_s * _LEASH_STEP
            if goal == self._target or abs(goal - self._sent) >= step:
                self._send(goal)
        return GripperState(
            time_s=self._clock.now_s(),
            width_mm=self._width_mm(tick),
            current_ma=abs(block.value(sts.PRESENT_CURRENT)) * sts.MA_PER_UNIT,
            moving=moving,
        )

    def stop(self) -> None:
        """Stop and send no further goals; see `BusServoGripper.stop`."""
        self._target = self._sent
        super().stop()

    def _start_movement(self, tick: int, *, velocity: int, now: int) -> None:
        self._target, self._velocity, self._was_still = tick, velocity, False
        self._sent = self._apply_leash(now)
        self._line.write_block(
            {sts.GOAL_POSITION: self._sent, sts.GOAL_TIME: 0, sts.GOAL_VELOCITY: velocity}
        )

    def _set_goal(self, tick: int) -> None:
        self._target = tick
        self._send(tick)

    def _set_up(self, torque_limit_percent: float) -> None:
        line = self._line
        start, end = sts.SETTINGS
        stored = line.read_block(start, end - start)
        number = stored.value(sts.MODEL_NUMBER)
        if number not in sts.MODELS:
            known = ", ".join(sts.MODELS.values())
            raise DeviceError(
                f"{line.name} has model number {number}, which is not supported; use {known}"
            )
        self._raise_reported_error()
        self._check_settings(stored)
        # The servo would accept more, but somebody has stored this limit to protect it.
        torque_limit = self._limit_in_units(
            "torque_limit_percent",
            torque_limit_percent,
            units=sts.FULL_TORQUE / 100.0,
            stored=stored,
            register=sts.MAX_TORQUE_LIMIT,
        )
        position = self._read().value(self.POSITION)
        self._raise_reported_error()
        if not 0 <= position < sts.TICKS:
            phase = sts.Phase(stored.value(sts.PHASE))
            remedy = (
                f"It counts turns: clear bit 4 (16) of {sts.PHASE}, which is {phase.value}, with "
                f"{self.TOOL}, then switch its supply off and on"
                if phase & sts.Phase.COUNTS_TURNS
                else "Switch its supply off and on, and read closed_tick again"
            )
            raise DeviceError(
                f"{line.name}: {self.POSITION} is {position}, but goals are 0 to {sts.TICKS - 1}: "
                f"the servo would turn fully to reach one. {remedy}"
            )
        self._check_travel(position)
        line.write(sts.TORQUE_LIMIT, torque_limit)
        line.write(sts.ACCELERATION, 0)
        # Replaces an old goal, to which the servo would move as soon as the torque is on.
        self._set_goal(position)
        line.confirm({sts.TORQUE_LIMIT: torque_limit, sts.ACCELERATION: 0})
        line.write(sts.TORQUE_ENABLE, 1)
        line.confirm({sts.TORQUE_ENABLE: 1})

    def _check_settings(self, stored: RegisterBlock) -> None:
        """Raise `DeviceError` if a stored setting sends the jaw to a wrong place or speed."""
        name, tool = self._line.name, self.TOOL
        if (mode := stored.value(sts.OPERATING_MODE)) != sts.POSITION_MODE:
            raise DeviceError(
                f"{name} is in operating mode {mode}; set {sts.OPERATING_MODE} to "
                f"{sts.POSITION_MODE} (position) with {tool}"
            )
        if not stored.value(sts.RESPONSE_LEVEL):
            raise DeviceError(
                f"{name}: {sts.RESPONSE_LEVEL} is 0: the servo acknowledges no commands. Set it "
                f"to 1 with {tool}"
            )
        phase = sts.Phase(stored.value(sts.PHASE))
        if not phase & sts.Phase.FINE_VELOCITY:
            raise DeviceError(
                f"{name}: {sts.PHASE} is {phase.value}: its velocities count 50 steps each, and "
                f"the jaw would move 50 times too fast. Set bit 2 (4) with {tool}"
            )
        directions = phase & (sts.Phase.MOTOR_REVERSED | sts.Phase.POSITION_REVERSED)
        if directions in (sts.Phase.MOTOR_REVERSED, sts.Phase.POSITION_REVERSED):
            raise DeviceError(
                f"{name}: {sts.PHASE} is {phase.value}: motor and position count in opposite "
                f"directions, and the servo would run away from its goal. Set bits 0 (1) and 7 "
                f"(128) to the same value with {tool}"
            )
        self._check_offset(stored)
        # Both limits 0 mean that there are none.
        if any(stored.value(limit) for limit in self.POSITION_LIMITS):
            self._check_position_limits(stored)

    def _last_goal(self, goal: int) -> int:
        return self._sent

    def _travel_mm(self) -> tuple[float, float]:
        # A horn with one jaw can turn by more than half a turn. Its travel is in the rig file only.
        return 0.0, self.limits.highest

    def _read_errors(self) -> sts.State:
        return sts.State(self._line.alert_bits)

    def _describe_recovery(self, *, torque: bool) -> str:
        return f"Then {'' if torque else 'switch its supply off and on, and '}open the rig again"

    def _describe_misfit(self, tick: int) -> str:
        if self._is_within_travel(2 * self._zero_tick - tick):
            return (
                f"With opens = {-self._opens} the jaw would be within: check opens "
                f"({self._opens}) first, then closed_tick ({self._zero_tick})"
            )
        return (
            f"Check closed_tick ({self._zero_tick}) and opens ({self._opens}); if they are right, "
            "the jaw is open wider than highest_mm: close it by hand, or give a larger highest_mm"
        )

    def _describe_wrong_zero(self) -> str:
        return (
            f"Close the jaw by hand, read closed_tick ({self._zero_tick}) again, and check opens "
            f"({self._opens}) and highest_mm ({self.limits.highest:g})"
        )

    def _apply_leash(self, now: int) -> int:
        """Return the target, or a goal within the leash from `now` while closing."""
        travel = self._target - now
        if travel * self._opens >= 0:
            return self._target
        leash = max(round(self._velocity * self._leash_s), 1)
        return self._target if -travel * self._opens <= leash else now - self._opens * leash

    def _send(self, tick: int) -> None:
        self._line.write(sts.GOAL_POSITION, tick)
        self._sent = tick


def open_gripper(
    *,
    port: str,
    jaw_mm: float,
    closed_tick: int,
    highest_mm: float,
    servo_id: int = 6,
    baud: int = 1_000_000,
    opens: int = 1,
    lowest_mm: float = 1.0,
    torque_limit_percent: float = 30.0,
    leash_s: float = 0.5,
    homing_offset: int = 0,
    reply_s: float = REPLY_S,
) -> FeetechGripper:
    """Open the gripper of an SO-101, or another gripper with one turning jaw.

    Parameters
    ----------
    port, servo_id, baud
        Serial port, number and baud rate of the servo; the gripper of an SO-101 is number 6.
    jaw_mm : float
        Distance from the servo's axis to the middle of the pad. Measure this distance.
    closed_tick, opens, torque_limit_percent, leash_s, homing_offset
        As in `FeetechGripper`.
    lowest_mm, highest_mm : float
        Range of the opening between the middles of the pads.
    reply_s : float
        Time limit for each reply. The servo counts as lost after three attempts.

    Raises
    ------
    InputError
        If a number is out of range, or the width is outside the jaw's range.
    DeviceError
        If there is no such port or servo, or the servo can't be set up.
    """
    jaw = HingedJaw(jaw_mm=jaw_mm)
    low, high = jaw.range_mm
    if not low <= lowest_mm < highest_mm <= high:
        raise InputError(
            f"lowest_mm {lowest_mm:g} and highest_mm {highest_mm:g}: the jaw opens from {low:g} to "
            f"{high:g} mm, and lowest_mm is the smaller one"
        )
    line = ServoLine(port, servo_id=servo_id, baud=baud, reply_s=reply_s, packets=PROTOCOL_1)
    try:
        return FeetechGripper(
            line,
            clock=RealClock(),
            jaw=jaw,
            limits=GripperLimits(
                drive="width", lowest=lowest_mm, highest=highest_mm, fastest=_FASTEST_MM_PER_S
            ),
            closed_tick=closed_tick,
            opens=opens,
            torque_limit_percent=torque_limit_percent,
            leash_s=leash_s,
            homing_offset=homing_offset,
        )
    except (DeviceError, InputError):
        line.close()
        raise
