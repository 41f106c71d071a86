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
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.servo_line import REPLY_S, ServoLine

#: Maximum speed of the jaw. The servo takes about a second for half a turn.
_FASTEST_MM_PER_S = 60.0


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

    Raises
    ------
    InputError
        If a number is out of range.
    DeviceError
        If the servo does not answer, is an unknown model, is in another mode, or is in a
        protection state.
    """

    RAD_PER_TICK = RAD_PER_S = sts.RAD_PER_TICK
    STATE, POSITION, MOVEMENT = sts.STATE, sts.PRESENT_POSITION, (sts.MOVING, 1)

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
    ) -> None:
        if opens not in (1, -1):
            raise InputError(
                f"opens {opens!r}: give 1 if positions increase as the jaw opens, otherwise -1"
            )
        if not 1.0 <= torque_limit_percent <= 100.0:
            raise InputError(f"torque_limit_percent {torque_limit_percent:g}: must be 1 to 100")
        if not 0.05 <= leash_s <= 2.0:
            raise InputError(f"leash_s {leash_s:g}: must be 0.05 to 2 s")
        super().__init__(
            line, clock=clock, fingers=jaw, limits=limits, zero_tick=closed_tick, opens=opens
        )
        self._leash_s = leash_s
        ends = [self._tick(width_mm) for width_mm in (limits.lowest, limits.highest)]
        if min(ends) < 0 or max(ends) >= sts.TICKS:
            raise InputError(
                f"closed_tick {closed_tick}: the jaw needs positions {min(ends)} to {max(ends)}, "
                f"but the servo has 0 to {sts.TICKS - 1}; remount its horn"
            )
        self._target = self._sent = self._velocity = 0
        self._was_still = True
        self._set_up(round(sts.FULL_TORQUE * torque_limit_percent / 100))

    def state(self) -> GripperState:
        """Read width, motion and current; during a long closing, send the next goal.

        Raises `DeviceError` if the servo does not answer or is in a protection state.
        """
        block = self._read()
        self._raise_reported_error()
        tick, is_turning = block.value(self.POSITION), self._is_moving(block)
        is_leashed = self._sent != self._target
        if is_leashed:
            self._send(self._apply_leash(tick))
        # A servo at rest in two successive readings, short of its target, is blocked.
        moving = is_turning or (is_leashed and not self._was_still)
        self._was_still = not is_turning
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
        self._line.write(sts.GOAL_VELOCITY, velocity)
        self._send(self._apply_leash(now))

    def _set_goal(self, tick: int) -> None:
        self._target = tick
        self._send(tick)

    def _set_up(self, torque_limit: int) -> None:
        line = self._line
        line.ping()
        number = line.read(sts.MODEL_NUMBER)
        if number not in sts.MODELS:
            known = ", ".join(sts.MODELS.values())
            raise DeviceError(
                f"{line.name} has model number {number}, which is not supported; use {known}"
            )
        if (mode := line.read(sts.OPERATING_MODE)) != sts.POSITION_MODE:
            raise DeviceError(
                f"{line.name} is in operating mode {mode}; set it to {sts.POSITION_MODE} (position)"
            )
        position = self._read().value(self.POSITION)
        self._raise_reported_error()
        line.write(sts.TORQUE_LIMIT, torque_limit)
        line.write(sts.ACCELERATION, 0)
        # Replaces an old goal, to which the servo would move as soon as the torque is on.
        self._set_goal(position)
        line.confirm({sts.TORQUE_LIMIT: torque_limit, sts.ACCELERATION: 0})
        line.write(sts.TORQUE_ENABLE, 1)
        line.confirm({sts.TORQUE_ENABLE: 1})

    def _raise_reported_error(self) -> None:
        if self._line.alert_bits:
            states = sts.State(self._line.alert_bits)
            names = ", ".join((state.name or str(state.value)).lower() for state in states)
            raise DeviceError(
                f"{self._line.name} protects itself: {names}; let it cool or remove the load, "
                "then switch its supply off and on"
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
    reply_s: float = REPLY_S,
) -> FeetechGripper:
    """Open the gripper of an SO-101, or another gripper with one turning jaw.

    Parameters
    ----------
    port, servo_id, baud
        Serial port, number and baud rate of the servo; the gripper of an SO-101 is number 6.
    jaw_mm : float
        Distance from the servo's axis to the middle of the pad. Measure this distance.
    closed_tick, opens, torque_limit_percent, leash_s
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
            f"{high:g} mm"
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
        )
    except (DeviceError, InputError):
        line.close()
        raise
