"""Pneumatic soft fingers on the regulator output of a board with palpate's firmware.

Pressure closes the fingers and venting opens them. The board vents the fingers after half a second
without a message, so that no pressure remains if the host fails. `state` sends the heartbeat.
"""

from __future__ import annotations

import math
from contextlib import suppress

from palpate.clock import Clock, RealClock
from palpate.errors import DeviceError, DeviceTimeoutError, InputError
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.sensor.array import PressureArray
from palpate.sensor.serial_array import HEARTBEAT_S, STALE_S, SerialArray
from palpate.sensor.wire_messages import (
    MAX_PRESSURE_KPA,
    BoardStatus,
    Command,
    Ping,
    SetPressure,
)

#: Pressure range of the paper's fingers (section 4.2), and a slew rate that they can follow.
SOFT_LIMITS = GripperLimits(drive="pressure", lowest=0.0, highest=MAX_PRESSURE_KPA, fastest=60.0)
#: Slew rate for venting: the board's maximum. The valve and the fingers are slower.
_VENT_KPA_PER_S = 500.0
#: Tolerance of the measured pressure (0.05 kPa resolution, plus noise), and its maximum lag.
_TOLERANCE_KPA, _LAG_S = 0.5, 0.5


class PneumaticGripper:
    """A `Gripper` on a board's regulator output.

    `board`: an open array whose frames contain the pressure (`Contents.PRESSURE`). The gripper does
        not close the array.
    `limits`: range of the pressure and its largest slew rate.
    """

    def __init__(
        self, board: SerialArray, *, clock: Clock, limits: GripperLimits = SOFT_LIMITS
    ) -> None:
        self.limits = limits
        self._board, self._clock = board, clock
        self._target_kpa = self._set_kpa = 0.0
        self._sent_s = self._commanded_s = self._arrives_s = -math.inf

    def state(self) -> GripperState:
        """Read the pressure, and send the board a heartbeat.

        Raises `DeviceError` if the board is lost, its frames contain no pressure, or the board has
        vented the fingers after a missing heartbeat.
        """
        now_s = self._clock.now_s()
        if now_s - self._sent_s >= HEARTBEAT_S:
            self._send(Ping())
        newest = self._board.read_newest()
        if newest is None:
            # The array was just opened: the fingers are vented.
            return GripperState(time_s=now_s, pressure_kpa=0.0, moving=now_s < self._arrives_s)
        set_kpa, pressure_kpa = newest.pressure_set_kpa, newest.pressure_kpa
        if set_kpa is None or pressure_kpa is None:
            raise DeviceError(
                "the board's frames contain no pressure; open the array with pressure = true"
            )
        age_s = now_s - self._board.newest_s
        if age_s > STALE_S:
            raise DeviceTimeoutError(
                f"the last pressure is {age_s:.2f} s old; check the board's cable. The board vents "
                "the fingers 0.5 s after it last received a command"
            )
        # Frames from before the last pressure command can still report an earlier silence.
        is_pressed = (
            self._target_kpa > self.limits.lowest and self._board.newest_s > self._commanded_s
        )
        if newest.status & BoardStatus.HEARTBEAT_LOST and is_pressed:
            raise DeviceError(
                "the board has vented the fingers: it received nothing for 0.5 s. Check its cable "
                "and the CPU load of this computer"
            )
        is_lagging = abs(pressure_kpa - self._target_kpa) > _TOLERANCE_KPA
        late_s = now_s - self._arrives_s
        moving = late_s < 0 or (is_lagging and late_s < _LAG_S)
        self._set_kpa = set_kpa
        return GripperState(time_s=now_s, pressure_kpa=pressure_kpa, moving=moving)

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send a pressure and a slew rate; return the command sent, rounded to whole pascals.

        Raises `DeviceError` if the board is lost, or if its ceiling has tripped and it accepts no
        pressure.
        """
        wanted = self.limits.clamp(wanted)
        target_kpa, slew = round(wanted.target, 3), round(max(wanted.rate, 0.001), 3)
        newest = self._board.read_newest()
        is_tripped = newest is not None and newest.status & BoardStatus.CEILING_TRIPPED
        if is_tripped and target_kpa > self.limits.lowest:
            raise DeviceError(
                "the board has vented the fingers: a pixel reached its ceiling. Remove the cause, "
                "then open the rig again"
            )
        return self._send_pressure(GripperCommand(target=target_kpa, rate=slew))

    def stop(self) -> None:
        """Vent the fingers, which cannot be held without a host.

        Raises `DeviceError` if the board is lost; the board then vents the fingers on its own.
        """
        self._send_pressure(GripperCommand(target=self.limits.lowest, rate=_VENT_KPA_PER_S))

    def release(self) -> None:
        """Vent."""
        self.stop()

    def close(self) -> None:
        """Vent the fingers; calling it again has no further effect."""
        # A lost board vents on its own.
        with suppress(DeviceError):
            self.stop()

    def _send_pressure(self, sent: GripperCommand) -> GripperCommand:
        self._send(SetPressure(target_kpa=sent.target, slew_kpa_per_s=sent.rate))
        change_kpa = max(abs(sent.target - self._set_kpa), abs(sent.target - self._target_kpa))
        self._commanded_s = self._sent_s
        self._arrives_s = self._commanded_s + change_kpa / sent.rate
        self._target_kpa = sent.target
        return sent

    def _send(self, command: Command) -> None:
        self._board.send(command)
        self._sent_s = self._clock.now_s()


def open_gripper(
    *, array: PressureArray, highest_kpa: float = MAX_PRESSURE_KPA
) -> PneumaticGripper:
    """Open a gripper with soft fingers on the sensor's board.

    Parameters
    ----------
    array : PressureArray
        The rig's array: a board opened with ``pressure = true``.
    highest_kpa : float
        Pressure limit of the fingers.

    Raises
    ------
    InputError
        If the array is not a board with palpate's firmware, or the pressure is out of range.
    """
    if not isinstance(array, SerialArray):
        raise InputError(
            f"soft fingers need an array on a board with a regulator, not {type(array).__name__}"
        )
    if not 0 < highest_kpa <= MAX_PRESSURE_KPA:
        raise InputError(
            f"highest_kpa {highest_kpa:g}: must be above 0 and at most {MAX_PRESSURE_KPA:g}"
        )
    limits = GripperLimits(
        drive="pressure", lowest=0.0, highest=highest_kpa, fastest=SOFT_LIMITS.fastest
    )
    return PneumaticGripper(array, clock=RealClock(), limits=limits)
