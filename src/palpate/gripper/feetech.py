"""A gripper on one Feetech STS3215 bus servo: a jaw against a fixed one (SO-101).

The servo follows a position and yields at a torque limit. It has no watchdog, so while closing
it is never sent further than it goes in `leash_s`: a host that falls silent stops the hand there.
`open_gripper` is what a rig file names for its `[gripper]`.
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

#: Of the jaw, mm/s: half a turn of it takes the servo about a second.
_FASTEST_MM_PER_S = 60.0


class FeetechGripper(BusServoGripper):
    """A `Gripper` behind a line of Feetech servos.

    Parameters
    ----------
    line : ServoLine
        An open line, Protocol 1.
    clock : Clock
        For the times of states.
    jaw : HingedJaw
        Angle to width.
    limits : GripperLimits
        Range of the opening and its largest speed.
    closed_tick : int
        Position, 0 to 4095, at which the pads touch.
    opens : {1, -1}
        Whether positions rise or fall as the jaw opens.
    torque_limit_percent : float
        Fraction of its torque at which the servo yields.
    leash_s : float
        Longest closing without a message from the host.

    Raises
    ------
    InputError
        If a number is out of range.
    DeviceError
        If the servo does not answer, is of an unknown kind or in another mode, or protects itself.
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
            raise InputError(f"opens {opens!r}: 1 where positions rise as the jaw opens, or -1")
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
                f"closed_tick {closed_tick}: the jaw would go from position {min(ends)} to "
                f"{max(ends)}, and the servo has 0 to {sts.TICKS - 1}; move its horn"
            )
        self._target = self._sent = self._velocity = 0
        self._stood = True
        self._set_up(round(sts.FULL_TORQUE * torque_limit_percent / 100))

    def state(self) -> GripperState:
        """Read width, motion and current; on a long closing, send the next goal.

        Raises `DeviceError` if it does not answer, or protects itself.
        """
        run = self._read()
        self._refuse_errors()
        tick, turning = run.value(self.POSITION), self._is_on_its_way(run)
        held_back = self._sent != self._target
        if held_back:
            self._send(self._apply_leash(tick))
        # Held back and standing in two states: something is in the way.
        moving = turning or (held_back and not self._stood)
        self._stood = not turning
        return GripperState(
            time_s=self._clock.now_s(),
            width_mm=self._width_mm(tick),
            current_ma=abs(run.value(sts.PRESENT_CURRENT)) * sts.MA_PER_UNIT,
            moving=moving,
        )

    def stop(self) -> None:
        """Stop where it is, and be sent on no further; see `BusServoGripper.stop`."""
        self._target = self._sent
        super().stop()

    def _start(self, tick: int, *, velocity: int, now: int) -> None:
        self._target, self._velocity, self._stood = tick, velocity, False
        self._line.write(sts.GOAL_VELOCITY, velocity)
        self._send(self._apply_leash(now))

    def _hold(self, tick: int) -> None:
        self._target = tick
        self._send(tick)

    def _set_up(self, torque_limit: int) -> None:
        line = self._line
        line.ping()
        number = line.read(sts.MODEL_NUMBER)
        if number not in sts.MODELS:
            known = ", ".join(sts.MODELS.values())
            raise DeviceError(f"{line.name} is of model number {number}; known are {known}")
        if (mode := line.read(sts.OPERATING_MODE)) != sts.POSITION_MODE:
            raise DeviceError(
                f"{line.name} is in operating mode {mode}; set it to {sts.POSITION_MODE} (position)"
            )
        here = self._read().value(self.POSITION)
        self._refuse_errors()
        line.write(sts.TORQUE_LIMIT, torque_limit)
        line.write(sts.ACCELERATION, 0)
        # An old goal would be gone to as soon as there is torque.
        self._hold(here)
        line.confirm({sts.TORQUE_LIMIT: torque_limit, sts.ACCELERATION: 0})
        line.write(sts.TORQUE_ENABLE, 1)
        line.confirm({sts.TORQUE_ENABLE: 1})

    def _refuse_errors(self) -> None:
        if self._line.alerted:
            reported = sts.State(self._line.alerted)
            names = ", ".join((one.name or str(one.value)).lower() for one in reported)
            raise DeviceError(
                f"{self._line.name} protects itself: {names}; let it cool or take the load away, "
                "then switch its supply off and on"
            )

    def _apply_leash(self, now: int) -> int:
        """Return how far it may be sent from `now`: to the end if it opens."""
        way = self._target - now
        if way * self._opens >= 0:
            return self._target
        leash = max(round(self._velocity * self._leash_s), 1)
        return self._target if -way * self._opens <= leash else now - self._opens * leash

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
    """Open the gripper of an SO-101, or another hand with one turning jaw.

    Parameters
    ----------
    port, servo_id, baud
        Where the servo is; the gripper of an SO-101 is number 6.
    jaw_mm : float
        From the servo's axis to the middle of the pad. Measure it.
    closed_tick, opens, torque_limit_percent, leash_s
        As in `FeetechGripper`.
    lowest_mm, highest_mm : float
        Range of the opening between the middles of the pads.
    reply_s : float
        How long each reply may take, three times over before the servo counts as lost.

    Raises
    ------
    InputError
        If a number is out of range, or the jaw can't reach the width.
    DeviceError
        If there is no such port or servo, or it can't be set up.
    """
    jaw = HingedJaw(jaw_mm=jaw_mm)
    low, high = jaw.reach_mm
    if not low <= lowest_mm < highest_mm <= high:
        raise InputError(
            f"lowest_mm {lowest_mm:g} and highest_mm {highest_mm:g}: the jaw goes from {low:g} to "
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
