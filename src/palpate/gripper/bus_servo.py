"""A gripper on one bus servo: the part common to servos of all makes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

from palpate.clock import Clock
from palpate.errors import DeviceError
from palpate.gripper.fingers import CrankFingers, HingedJaw
from palpate.gripper.interface import GripperCommand, GripperLimits
from palpate.gripper.packets import Register, RegisterRun
from palpate.gripper.servo_line import ServoLine

#: A stop is confirmed by readings that report standing still, within this time.
_STOPPED_S, _STOPPED_POLL_S = 0.3, 0.01


class BusServoGripper(ABC):
    """A `Gripper` behind a servo line.

    `fingers`: angle to width.
    `zero_tick`: position of their angle 0.
    `opens` (1 or -1): whether positions rise or fall as they open.
    """

    #: Of one unit of the servo's position, and of its velocity.
    RAD_PER_TICK: ClassVar[float]
    RAD_PER_S: ClassVar[float]
    #: Addresses between which position, motion and current lie: they are read in one packet.
    STATE: ClassVar[tuple[int, int]]
    POSITION: ClassVar[Register]
    #: Bits that show a movement that a stop has to end.
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
    def _refuse_errors(self) -> None:
        """Raise if the servo's last reply reported an error."""

    @abstractmethod
    def _start(self, tick: int, *, velocity: int, now: int) -> None:
        """Send the servo from `now` to a position."""

    @abstractmethod
    def _hold(self, tick: int) -> None:
        """Make a position that it is passing its goal."""

    def command(self, wanted: GripperCommand) -> GripperCommand:
        """Send the fingers to a width; return the width sent, in whole servo steps.

        The rate returned is the mean over the travel: the servo turns evenly, the fingers don't.

        Raises `DeviceError` if it does not answer, or reports an error.
        """
        wanted = self.limits.clamp(wanted)
        now = self._read().value(self.POSITION)
        self._refuse_errors()
        low_mm, high_mm = self._fingers.reach_mm
        now_mm = min(max(self._width_mm(now), low_mm), high_mm)
        tick = self._tick(wanted.target)
        sent_mm = self._width_mm(tick)
        steepest = self._fingers.steepest_mm_per_rad(now_mm, sent_mm)
        # 0 would mean as fast as it can.
        velocity = max(int(wanted.rate / steepest / self.RAD_PER_S), 1)
        self._start(tick, velocity=velocity, now=now)
        takes_s = abs(tick - now) * self.RAD_PER_TICK / (velocity * self.RAD_PER_S)
        mean = abs(sent_mm - now_mm) / takes_s if takes_s > 0 else wanted.rate
        return GripperCommand(target=sent_mm, rate=mean)

    def stop(self) -> None:
        """Stop a moving servo where it is.

        A new goal at rest would only loosen a grip.

        Raises `DeviceError` if no reading confirms that it stands still.
        """
        until_s = self._clock.now_s() + _STOPPED_S
        while self._is_on_its_way(run := self._read()):
            self._hold(run.value(self.POSITION))
            if self._clock.now_s() >= until_s:
                raise DeviceError(
                    f"{self._line.name} got a stop but still moves after {_STOPPED_S:g} s; "
                    "take its supply away"
                )
            self._clock.sleep_s(_STOPPED_POLL_S)

    def release(self) -> None:
        """Open fully."""
        self.command(GripperCommand(target=self.limits.highest, rate=self.limits.fastest))

    def close(self) -> None:
        """Close the port; the servo holds its position. Calling it again does nothing."""
        self._line.close()

    def _read(self) -> RegisterRun:
        begin, end = self.STATE
        return self._line.read_run(begin, end - begin)

    def _is_on_its_way(self, run: RegisterRun) -> bool:
        register, bits = self.MOVEMENT
        return bool(run.value(register) & bits)

    def _width_mm(self, tick: int) -> float:
        return self._fingers.width_mm(self._opens * (tick - self._zero_tick) * self.RAD_PER_TICK)

    def _tick(self, width_mm: float) -> int:
        return self._zero_tick + self._opens * round(
            self._fingers.angle_rad(width_mm) / self.RAD_PER_TICK
        )
