"""Rack fingers on a hobby servo, driven by pulses from a board with palpate's firmware.

The board enforces travel and ramp, and holds the fingers in place after half a second without a
message. `state` sends the heartbeat. The reported width is computed from the pulses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, DeviceTimeoutError, InputError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.gripper.settings import check_number
from palpate.sensor.array import PressureArray
from palpate.sensor.serial_array import HEARTBEAT_S, STALE_S, SerialArray
from palpate.sensor.wire_messages import (
    SERVO_PULSES_US,
    BoardStatus,
    Command,
    Ping,
    SetServo,
    SetServoTravel,
)

#: Largest opening of a hand for produce, and the largest rates that a grasp can use. Others are
#: slips of the pen.
_MAX_MM, _MIN_RATE_MM_PER_S, _MAX_RATE_MM_PER_S = 300.0, 1.0, 500.0
#: Delay of a servo relative to its pulses: one period of 20 ms and the servo's own lag (guess).
_LAG_S = 0.1
#: A frame reports the effect of a command after this time: one ping and one frame at 15 Hz.
_COMMAND_DELAY_S = 0.2


@dataclass(frozen=True, slots=True, kw_only=True)
class ServoTravel:
    """Pulse widths and openings at both ends of the travel; linear in between.

    Examples
    --------
    >>> travel = ServoTravel(open_us=700, closed_us=2300, open_mm=74.0, closed_mm=5.0)
    >>> travel.pulse_us(39.5), travel.width_mm(1500)
    (1500, 39.5)
    """

    open_us: int
    closed_us: int
    open_mm: float
    closed_mm: float

    def __post_init__(self) -> None:
        low, high = SERVO_PULSES_US
        for name in ("open_us", "closed_us"):
            check_number(name, getattr(self, name), low=low, high=high, unit="µs", whole=True)
        if self.open_us == self.closed_us:
            raise InputError("open_us and closed_us are equal: measure both ends of the travel")
        if not 0 <= self.closed_mm < self.open_mm:
            raise InputError(
                f"closed_mm {self.closed_mm:g}: must be at least 0 and below open_mm "
                f"{self.open_mm:g}"
            )
        check_number("open_mm", self.open_mm, low=0.0, high=_MAX_MM, unit="mm")

    @property
    def mm_per_us(self) -> float:
        """Absolute change of the opening per microsecond of pulse width."""
        return (self.open_mm - self.closed_mm) / abs(self.open_us - self.closed_us)

    def width_mm(self, pulse_us: float) -> float:
        """Return the opening at a pulse width."""
        return self.open_mm - self.mm_per_us * abs(pulse_us - self.open_us)

    def pulse_us(self, width_mm: float) -> int:
        """Return the pulse width at an opening within the travel."""
        direction = math.copysign(1.0, self.closed_us - self.open_us)
        return self.open_us + round(direction * (self.open_mm - width_mm) / self.mm_per_us)


class HobbyServoGripper:
    """A `Gripper` on a board's servo output.

    The constructor opens the fingers, unless the board already sends pulses.

    `board`: an open array whose frames contain the pulses (`Contents.SERVO`). The gripper does not
        close the array.
    `travel`: both ends of the travel, which limit the pulses.
    `fastest_mm_per_s`: largest rate.
    """

    def __init__(
        self,
        board: SerialArray,
        *,
        clock: Clock,
        travel: ServoTravel,
        fastest_mm_per_s: float = 60.0,
    ) -> None:
        self.limits = GripperLimits(
            drive="width",
            lowest=travel.closed_mm,
            highest=travel.open_mm,
            fastest=fastest_mm_per_s,
        )
        self._board, self._clock, self._travel = board, clock, travel
        self._sent_s = self._commanded_s = self._arrives_s = -math.inf
        newest, self._rate = board.read_newest(), 1
        self._pulse_us: float = (newest and newest.servo_us) or travel.open_us
        self._target_us: float = self._pulse_us
        self._send(SetServoTravel(open_us=travel.open_us, closed_us=travel.closed_us))
        if newest is None or not newest.servo_us:
            self.release()

    def state(self) -> GripperState:
        """Return the opening at the present pulse width, and send the board a heartbeat.

        Raises `DeviceError` if the board is lost, sends no pulses, or has stopped the fingers after
        a missing heartbeat.
        """
        now_s = self._clock.now_s()
        if now_s - self._sent_s >= HEARTBEAT_S:
            self._send(Ping())
        newest = self._board.read_newest()
        if newest is not None:
            if newest.servo_us is None:
                raise DeviceError(
                    "the board's frames contain no servo pulses; open the array with servo = true"
                )
            age_s = now_s - self._board.newest_s
            if age_s > STALE_S:
                raise DeviceTimeoutError(
                    f"the last servo pulse is {age_s:.2f} s old; check the board's cable. The "
                    "board stops the fingers and holds them in place if it receives nothing for "
                    "0.5 s"
                )
            if newest.status & BoardStatus.CEILING_TRIPPED:
                self._target_us = self._travel.open_us
            if self._board.newest_s > self._commanded_s + _COMMAND_DELAY_S:
                self._check_status(newest.status, newest.servo_us)
            self._pulse_us = self._extrapolate_pulse(newest.servo_us or self._travel.open_us, now_s)
        late_s = now_s - self._arrives_s
        is_lagging = self._pulse_us != self._target_us and late_s < STALE_S
        return GripperState(
            time_s=now_s,
            width_mm=self._travel.width_mm(self._pulse_us),
            moving=late_s < _LAG_S or is_lagging,
        )

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a width and a rate; return the command sent, rounded to whole microseconds.

        Raises `DeviceError` if the board is lost or its ceiling has tripped.
        """
        wanted = self.limits.clamp(wanted)
        newest = self._board.read_newest()
        is_tripped = newest is not None and newest.status & BoardStatus.CEILING_TRIPPED
        if is_tripped and wanted.target < self.limits.highest:
            raise DeviceError(
                "the board has opened the fingers: a pixel reached its ceiling. Remove the cause, "
                "then open the rig again"
            )
        target_us = self._travel.pulse_us(wanted.target)
        rate = max(math.floor(wanted.rate / self._travel.mm_per_us), 1)
        self._send(SetServo(target_us=target_us, rate_us_per_s=rate))
        self._commanded_s = self._sent_s
        travel_us = max(abs(target_us - self._pulse_us), abs(target_us - self._target_us))
        self._target_us, self._rate = target_us, rate
        self._arrives_s = self._sent_s + travel_us / rate
        return GripperCommand(
            target=self._travel.width_mm(target_us), rate=rate * self._travel.mm_per_us
        )

    def stop(self) -> None:
        """Stop the fingers and hold their position.

        Raises `DeviceError` if the board is lost; the board then stops the fingers 0.5 s later.
        """
        self._send(SetServo(target_us=0, rate_us_per_s=1))
        self._commanded_s = self._arrives_s = self._sent_s
        self._target_us = self._pulse_us

    def release(self) -> None:
        """Open fully."""
        self.command(GripperCommand(target=self.limits.highest, rate=self.limits.fastest))

    def close(self) -> None:
        """Do nothing: the board holds the fingers in place."""

    def _extrapolate_pulse(self, reported_us: int, now_s: float) -> float:
        """Extrapolate the newest frame, which can be 70 ms old, to the present pulse width."""
        elapsed_s = max(now_s - max(self._board.newest_s, self._commanded_s), 0.0)
        remaining_us = self._target_us - reported_us
        step_us = min(abs(remaining_us), self._rate * elapsed_s)
        return reported_us + math.copysign(step_us, remaining_us)

    def _check_status(self, status: int, servo_us: int) -> None:
        if status & BoardStatus.CEILING_TRIPPED:
            return  # every frame reports the trip
        if servo_us == 0:
            raise DeviceError(
                "the board sends no servo pulses: it was reset and has cut power to the servo. "
                "Open the rig again"
            )
        if status & BoardStatus.HEARTBEAT_LOST and abs(servo_us - self._target_us) <= 1:
            # The fingers had arrived, and have not moved: this program was busy elsewhere.
            self._send(SetServo(target_us=servo_us, rate_us_per_s=self._rate))
            self._commanded_s = self._sent_s
        elif status & BoardStatus.HEARTBEAT_LOST:
            raise DeviceError(
                "the board holds the fingers in place: it received nothing for 0.5 s. "
                "Check its cable and the CPU load of this computer"
            )

    def _send(self, command: Command) -> None:
        self._board.send(command)
        self._sent_s = self._clock.now_s()


def open_gripper(
    *,
    array: PressureArray,
    open_us: int,
    closed_us: int,
    open_mm: float,
    closed_mm: float,
    fastest_mm_per_s: float = 60.0,
) -> HobbyServoGripper:
    """Open a gripper with a hobby servo on the sensor's board, and open its fingers.

    Parameters
    ----------
    array : PressureArray
        The rig's array: a board opened with ``servo = true``.
    open_us, closed_us : int
        Pulse widths of the open and the closed fingers, 500 to 2500 µs.
    open_mm, closed_mm : float
        Opening between the pads at these pulse widths. Measure both openings.
    fastest_mm_per_s : float
        Largest rate.

    Raises
    ------
    InputError
        If the array is not a board with palpate's firmware, or a number is out of range.
    DeviceError
        If the board is lost.
    """
    if not isinstance(array, SerialArray):
        raise InputError(
            f"a hobby servo needs an array on a board with palpate's firmware, not "
            f"{type(array).__name__}"
        )
    check_number(
        "fastest_mm_per_s",
        fastest_mm_per_s,
        low=_MIN_RATE_MM_PER_S,
        high=_MAX_RATE_MM_PER_S,
        unit="mm/s",
    )
    travel = ServoTravel(open_us=open_us, closed_us=closed_us, open_mm=open_mm, closed_mm=closed_mm)
    return HobbyServoGripper(
        array, clock=RealClock(), travel=travel, fastest_mm_per_s=fastest_mm_per_s
    )
