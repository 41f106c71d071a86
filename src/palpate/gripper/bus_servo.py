"""A gripper on one bus servo: the common base of the drivers for each make."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from palpate.clock import Clock
from palpate.errors import DeviceError
from palpate.gripper.fingers import CrankFingers, HingedJaw
from palpate.gripper.interface import GripperCommand, GripperLimits
from palpate.gripper.packets import Register, RegisterBlock
from palpate.gripper.servo_line import ServoLine

#: Time limit for the readings that confirm a stop, and their interval.
_STOP_TIMEOUT_S, _STOP_POLL_S = 0.3, 0.01


class BusServoGripper(ABC):
    """A `Gripper` on a servo line.

    `fingers`: converts the servo angle to the width.
    `zero_tick`: servo position at angle 0.
    `opens`: 1 if positions increase as the fingers open, -1 if they decrease.
    """

    #: Angle of one position unit, and angular speed of one velocity unit.
    RAD_PER_TICK: ClassVar[float]
    RAD_PER_S: ClassVar[float]
    #: Address range with position, motion and current, read in one packet.
    STATE: ClassVar[tuple[int, int]]
    POSITION: ClassVar[Register]
    #: Register and bits that report a movement.
    MOVEMENT: ClassVar[tuple[Register, int]]

    def __init__(
        self,
        line: ServoLine,
        *,
        clock: Clock,
        fingers: CrankFingers | HingedJaw,
        limits: GripperLimits,
        zero_tick: int,
        opens: int = 1,
    ) -> None:
        self.limits = limits
        self._line, self._clock, self._fingers = line, clock, fingers
        self._zero_tick, self._opens = zero_tick, opens

    @abstractmethod
    def _raise_reported_error(self) -> None:
        """Raise `DeviceError` if the servo's last reply reported an error."""

    @abstractmethod
    def _start_movement(self, tick: int, *, velocity: int, now: int) -> None:
        """Start a movement from position `now` to position `tick`."""

    @abstractmethod
    def _set_goal(self, tick: int) -> None:
        """Set the goal to `tick`, the current position, to stop the servo."""

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Move the fingers to a width; return the command sent, rounded to servo steps.

        The returned rate is the mean over the movement: the servo speed is constant, the finger
        speed is not.

        Raises `DeviceError` if the servo does not answer or reports an error.
        """
        wanted = self.limits.clamp(wanted)
        now = self._read().value(self.POSITION)
        self._raise_reported_error()
        low_mm, high_mm = self._fingers.range_mm
        now_mm = min(max(self._width_mm(now), low_mm), high_mm)
        tick = self._tick(wanted.target)
        sent_mm = self._width_mm(tick)
        max_mm_per_rad = self._fingers.max_mm_per_rad(now_mm, sent_mm)
        # The servo interprets velocity 0 as its maximum speed.
        velocity = max(int(wanted.rate / max_mm_per_rad / self.RAD_PER_S), 1)
        self._start_movement(tick, velocity=velocity, now=now)
        duration_s = abs(tick - now) * self.RAD_PER_TICK / (velocity * self.RAD_PER_S)
        mean_rate = abs(sent_mm - now_mm) / duration_s if duration_s > 0 else wanted.rate
        return GripperCommand(target=sent_mm, rate=mean_rate)

    def stop(self) -> None:
        """Stop a moving servo at its current position.

        A servo at rest gets no new goal, because that would loosen the grip.

        Raises `DeviceError` if no reading confirms the stop.
        """
        deadline_s = self._clock.now_s() + _STOP_TIMEOUT_S
        while self._is_moving(block := self._read()):
            self._set_goal(block.value(self.POSITION))
            if self._clock.now_s() >= deadline_s:
                raise DeviceError(
                    f"{self._line.name} got a stop but still moves after {_STOP_TIMEOUT_S:g} s; "
                    "disconnect its supply"
                )
            self._clock.sleep_s(_STOP_POLL_S)

    def release(self) -> None:
        """Open fully."""
        self.command(GripperCommand(target=self.limits.highest, rate=self.limits.fastest))

    def close(self) -> None:
        """Close the port; the servo holds its position. Calling it again does nothing."""
        self._line.close()

    def _read(self) -> RegisterBlock:
        start, end = self.STATE
        return self._line.read_block(start, end - start)

    def _is_moving(self, block: RegisterBlock) -> bool:
        register, bits = self.MOVEMENT
        return bool(block.value(register) & bits)

    def _width_mm(self, tick: int) -> float:
        return self._fingers.width_mm(self._opens * (tick - self._zero_tick) * self.RAD_PER_TICK)

    def _tick(self, width_mm: float) -> int:
        return self._zero_tick + self._opens * round(
            self._fingers.angle_rad(width_mm) / self.RAD_PER_TICK
        )
