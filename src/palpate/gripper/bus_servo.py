"""A gripper on one bus servo: the common base of the drivers for each make."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from enum import IntFlag
from math import degrees, isfinite
from typing import ClassVar

from palpate.clock import Clock
from palpate.errors import DeviceError, InputError
from palpate.gripper.fingers import CrankFingers, HingedJaw
from palpate.gripper.interface import GripperCommand, GripperLimits
from palpate.gripper.packets import Register, RegisterBlock
from palpate.gripper.servo_line import ServoLine

#: Time limit for a stop, and for the rest of a movement after its calculated end; interval of the
#: readings that confirm a stop.
_STOP_TIMEOUT_S, _STOP_POLL_S = 0.3, 0.01
#: A command uses the position of a reading that is not older, instead of reading it again: a
#: reply can itself be 16 ms late. The position serves only to choose the speed.
_FRESH_S = 0.02
#: Maximum speed of these servos (rad/s) and error of a reading (rad). A position that the servo
#: cannot have reached is the answer of another servo, or an encoder fault.
_MAX_RAD_PER_S, _READING_ERROR_RAD = 12.0, 0.2
#: How far beyond its travel a hand at its end stop may stand: pads yield, and horns have play. An
#: opening that ends short of its goal by more has met the end stop too early.
_END_STOP_RAD = 0.1


@dataclass(frozen=True, slots=True)
class _Movement:
    """A commanded movement: first position, goal, begin and calculated end.

    `is_checked`: whether the torque was read, because the servo did not move.
    """

    begin: int
    goal: int
    begins_s: float
    ends_s: float
    is_checked: bool = False


class BusServoGripper(ABC):
    """A `Gripper` on a servo line.

    `fingers`: converts the servo angle to the width.
    `zero_tick`: servo position at angle 0.
    `opens`: 1 if positions increase as the fingers open, -1 if they decrease.
    `homing_offset`: the value that the servo stores as the shift of its positions.
    """

    #: Angle of one position unit, and angular speed of one velocity unit.
    RAD_PER_TICK: ClassVar[float]
    RAD_PER_S: ClassVar[float]
    #: Address range with goal, position, motion and current, read in one packet.
    STATE: ClassVar[tuple[int, int]]
    POSITION: ClassVar[Register]
    #: Register and bits that report a movement.
    MOVEMENT: ClassVar[tuple[Register, int]]
    #: Registers of the goal, of the torque, of the temperature in °C, of the supply in 0.1 V with
    #: its limits, and of the stored shift, direction and range of the positions.
    GOAL: ClassVar[Register]
    TORQUE: ClassVar[Register]
    TEMPERATURE: ClassVar[Register]
    VOLTAGE: ClassVar[Register]
    VOLTAGE_LIMITS: ClassVar[tuple[Register, Register]]
    OFFSET: ClassVar[Register]
    DIRECTION: ClassVar[Register]
    POSITION_LIMITS: ClassVar[tuple[Register, Register]]
    #: The manufacturer's program that changes stored settings.
    TOOL: ClassVar[str]

    def __init__(
        self,
        line: ServoLine,
        *,
        clock: Clock,
        fingers: CrankFingers | HingedJaw,
        limits: GripperLimits,
        zero_tick: int,
        max_velocity: int,
        opens: int = 1,
        homing_offset: int = 0,
    ) -> None:
        self.limits = limits
        self._line, self._clock, self._fingers = line, clock, fingers
        self._zero_tick, self._opens, self._homing_offset = zero_tick, opens, homing_offset
        self._max_velocity = max_velocity
        #: Time and position of the last reading.
        self._latest: tuple[float, int] | None = None
        #: The last commanded movement, until it has arrived or was stopped.
        self._movement: _Movement | None = None

    @abstractmethod
    def _read_errors(self) -> IntFlag:
        """Return the errors of the servo, whose last reply reported one."""

    @abstractmethod
    def _describe_recovery(self, *, torque: bool) -> str:
        """Return what to do after the cause of an error is removed."""

    @abstractmethod
    def _describe_misfit(self, tick: int) -> str:
        """Return why the position can be outside the travel, and the remedy."""

    @abstractmethod
    def _describe_wrong_zero(self) -> str:
        """Return why positions can differ from those of the mechanism, and the remedy."""

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
        now = self._find_position()
        low_mm, high_mm = self._fingers.range_mm
        now_mm = min(max(self._width_mm(now), low_mm), high_mm)
        tick = self._tick(wanted.target)
        sent_mm = self._width_mm(tick)
        max_mm_per_rad = self._fingers.max_mm_per_rad(now_mm, sent_mm)
        # The servo interprets velocity 0 as its maximum speed. The slope is 0 at the end of a
        # mechanism's travel.
        fastest = wanted.rate / max(max_mm_per_rad, 1e-9) / self.RAD_PER_S
        velocity = max(int(min(fastest, self._max_velocity)), 1)
        self._start_movement(tick, velocity=velocity, now=now)
        # The acknowledgement reports errors too.
        self._raise_reported_error()
        duration_s = abs(tick - now) * self.RAD_PER_TICK / (velocity * self.RAD_PER_S)
        begins_s = self._clock.now_s()
        self._movement = _Movement(now, tick, begins_s, begins_s + duration_s)
        mean_rate = abs(sent_mm - now_mm) / duration_s if duration_s > 0 else wanted.rate
        return GripperCommand(target=sent_mm, rate=mean_rate)

    def stop(self) -> None:
        """Stop a moving servo at its current position.

        A servo at rest gets no new goal, because that would loosen the grip.

        Raises `DeviceError` if no reading confirms the stop.
        """
        deadline_s = self._clock.now_s() + _STOP_TIMEOUT_S
        self._movement = None
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

    def _find_position(self) -> int:
        """Return the position of a reading that was just made, or read it."""
        if self._latest is not None and self._clock.now_s() - self._latest[0] <= _FRESH_S:
            return self._latest[1]
        block = self._read()
        self._raise_reported_error()
        return self._take_position(block)

    def _take_position(self, block: RegisterBlock) -> int:
        """Return the position; raise `DeviceError` if the servo can't have reached it in time."""
        now_s, tick = self._clock.now_s(), block.value(self.POSITION)
        last, self._latest = self._latest, (now_s, tick)
        if last is None:
            return tick
        last_s, last_tick = last
        max_rad = _MAX_RAD_PER_S * (now_s - last_s) + _READING_ERROR_RAD
        if abs(tick - last_tick) > max_rad / self.RAD_PER_TICK:
            raise DeviceError(
                f"{self._line.name} reports position {tick}, {now_s - last_s:.2f} s after "
                f"{last_tick}: no servo turns that fast. Check the servo's cable, and reply_s in "
                "the rig file"
            )
        return tick

    # -- the movement as executed ------------------------------------------------------------------

    def _follow_movement(self, block: RegisterBlock, *, moving: bool) -> bool:
        """Compare a reading with the commanded movement; return whether the servo still moves.

        Raises `DeviceError` if the servo moves away from its goal, rests with another goal than
        the one sent, stays where it was without torque, or stops short of the goal while opening.
        A closing that stops short has met an object.
        """
        movement, tick = self._movement, block.value(self.POSITION)
        if movement is None:
            return moving
        direction = 1 if movement.goal > movement.begin else -1
        left_rad = direction * (movement.goal - tick) * self.RAD_PER_TICK
        away_rad = direction * (movement.begin - tick) * self.RAD_PER_TICK
        has_goal = block.value(self.GOAL) == self._last_goal(movement.goal)
        is_short = left_rad > _END_STOP_RAD and direction == self._opens
        if away_rad > 0 and self._clock.now_s() < movement.begins_s + _STOP_TIMEOUT_S:
            # The earlier movement is still being stopped.
            self._movement = replace(movement, begin=tick)
            return moving
        is_over = self._clock.now_s() >= movement.ends_s + _STOP_TIMEOUT_S
        if is_over and not moving and tick == movement.begin != movement.goal:
            if not movement.is_checked:
                self._raise_lost_torque(tick)
            self._movement = replace(movement, is_checked=True)
        if away_rad <= _READING_ERROR_RAD and (moving or (has_goal and not is_short)):
            return moving
        if self._is_stopped_by_silence():
            self._movement = None
            return False
        self._raise_lost_torque(tick)
        if not has_goal:
            self._raise_wrong_goal(block)
        if away_rad > _READING_ERROR_RAD:
            raise DeviceError(
                f"{self._line.name} moved from position {movement.begin} to {tick}, away from its "
                f"goal {movement.goal}: something moves the fingers, or the servo runs backwards; "
                f"check {self.DIRECTION} with {self.TOOL}"
            )
        if not is_over:
            return True  # an end stop and a slow servo look alike until then
        raise DeviceError(
            f"{self._line.name} stopped at position {tick} while opening to {movement.goal}, "
            f"{degrees(left_rad):.0f}° short of it. If nothing blocks the fingers, they are at "
            f"their end stop, and all positions are at least {abs(movement.goal - tick)} steps "
            f"wrong. {self._describe_wrong_zero()}"
        )

    def _raise_lost_torque(self, tick: int) -> None:
        """Raise `DeviceError` if the torque is off."""
        if not self._line.read(self.TORQUE):
            raise DeviceError(
                f"{self._line.name} is at position {tick} without torque: its supply was "
                "interrupted, or another program switched the torque off. Open the rig again"
            )

    def _raise_wrong_goal(self, block: RegisterBlock) -> None:
        """Raise `DeviceError`, because the servo has another goal than the one sent."""
        line, found = self._line, block.value(self.GOAL)
        sent = self._last_goal(self._movement.goal if self._movement else found)
        low, high = (f"{limit}, now {line.read(limit)}" for limit in self.POSITION_LIMITS)
        raise DeviceError(
            f"{line.name} is at position {block.value(self.POSITION)}: {self.GOAL} is {found}, "
            f"but {sent} was sent. The servo limits its goals, or another program uses it: check "
            f"{low}, and {high}, with {self.TOOL}"
        )

    def _last_goal(self, goal: int) -> int:
        """Return the goal that the servo should have now, on the way to `goal`."""
        return goal

    def _is_stopped_by_silence(self) -> bool:
        """Return whether the servo has stopped because the host was silent."""
        return False

    # -- the servo as found ------------------------------------------------------------------------

    def _check_offset(self, settings: RegisterBlock) -> None:
        """Raise `DeviceError` if the stored shift of the positions is not the expected one."""
        found = settings.value(self.OFFSET)
        if found != self._homing_offset:
            raise DeviceError(
                f"{self._line.name}: {self.OFFSET} is {found}, but the rig file expects "
                f"{self._homing_offset}: all positions are shifted. Set the register to "
                f"{self._homing_offset} with {self.TOOL}; or, if this shift is intended, add "
                f"homing_offset = {found} to [gripper]"
            )

    def _check_position_limits(self, settings: RegisterBlock) -> None:
        """Raise `DeviceError` if the stored limits exclude a position that the fingers need."""
        low, high = self._goal_ticks()
        smallest, largest = self.POSITION_LIMITS
        fault = None
        if (found := settings.value(smallest)) > low:
            fault = f"{smallest} is {found}", f"{low} or less"
        elif (found := settings.value(largest)) < high:
            fault = f"{largest} is {found}", f"{high} or more"
        if fault:
            raise DeviceError(
                f"{self._line.name}: {fault[0]}, but the fingers need positions {low} to {high}. "
                f"Set it to {fault[1]} with {self.TOOL}, or change the range in the rig file"
            )

    def _limit_in_units(
        self, name: str, value: float, *, units: float, stored: RegisterBlock, register: Register
    ) -> int:
        """Return a limit in servo units; raise `InputError` above the servo's stored limit."""
        max_units = stored.value(register)
        limit = round(value * units) if isfinite(value) else 0
        if not 1 <= limit <= max_units:
            raise InputError(
                f"{name} {value:g}: must be above 0 and at most {max_units / units:g}, the limit "
                f"stored in {register} of the servo; {self.TOOL} can change it"
            )
        return limit

    def _goal_ticks(self) -> tuple[int, int]:
        ends = [self._tick(width_mm) for width_mm in (self.limits.lowest, self.limits.highest)]
        return min(ends), max(ends)

    def _is_within_travel(self, tick: int) -> bool:
        low_rad, high_rad = map(self._fingers.angle_rad, self._travel_mm())
        angle_rad = self._opens * (tick - self._zero_tick) * self.RAD_PER_TICK
        return low_rad - _END_STOP_RAD <= angle_rad <= high_rad + _END_STOP_RAD

    def _travel_mm(self) -> tuple[float, float]:
        """Return the openings between which the fingers can be found."""
        return self._fingers.range_mm

    def _check_travel(self, tick: int) -> None:
        """Raise `DeviceError` if the fingers can't be at this position.

        A shift that leaves the position within the travel can't be seen without a movement.
        """
        if self._is_within_travel(tick):
            return
        low, high = sorted(map(self._tick, self._travel_mm()))
        outside = max(low - tick, tick - high)
        raise DeviceError(
            f"{self._line.name}: {self.POSITION} is {tick}, "
            f"{degrees(outside * self.RAD_PER_TICK):.0f}° outside the fingers' travel of {low} to "
            f"{high}. {self._describe_misfit(tick)}"
        )

    # -- errors ------------------------------------------------------------------------------------

    def _raise_reported_error(self) -> None:
        """Raise `DeviceError` if the servo's last reply reported an error."""
        if not self._line.alert_bits:
            return
        errors = self._read_errors()
        names = [(error.name or "").lower().replace("_", " ") for error in errors]
        if unknown := errors.value & ~sum(error.value for error in errors):
            names.append(f"error {unknown:#04x}")
        # Two errors can have the same cause.
        advice = list(dict.fromkeys(filter(None, map(self._describe_remedy, names))))
        torque = bool(self._line.read(self.TORQUE))
        advice.append(self._describe_recovery(torque=torque))
        raise DeviceError(
            f"{self._line.name} protects itself: {', '.join(names)}; its torque is "
            f"{'on' if torque else 'off'}. {' '.join(advice)}"
        )

    def _describe_remedy(self, error: str) -> str:
        if "voltage" in error:
            line, (low, high) = self._line, self.VOLTAGE_LIMITS
            volts, low_v, high_v = (0.1 * line.read(one) for one in (self.VOLTAGE, low, high))
            return (
                f"Its supply is at {volts:.1f} V now ({low_v:.1f} to {high_v:.1f} V are allowed): "
                "check the supply, its largest current and its cable."
            )
        if "heat" in error:
            return f"The servo is at {self._line.read(self.TEMPERATURE)} °C: let it cool."
        if "over" in error:
            return "The load was too large: remove what blocks the fingers, or grip more gently."
        if "shock" in error:
            return "Check its supply and the wiring for a short circuit."
        if "encoder" in error:
            return "Its position sensor fails: replace the servo if this returns."
        return ""
