"""Simulated Feetech STS3215 servos on a pseudo-terminal: one moves the twin's fingers.

The servo implements its protocol manual: checksums, state bits in every reply, sign-magnitude
values. It has no watchdog, and moves to its goal without a host. Goals beyond its stored angle
limits are shortened without an error. With one bit of its phase it counts turns, without another
its velocities count 50 steps each. The torque limit is checked only when the world is read, and is
converted to a force with a linear law.

Further servos on the same line, those of an arm, move freely to their goals.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from palpate.gripper import sts_series as sts
from palpate.gripper.fingers import HingedJaw
from palpate.gripper.interface import GripperCommand
from palpate.gripper.packets import Register
from palpate.twin.simulated_servo import SimulatedServo
from palpate.twin.world import World

_HEADER = b"\xff\xff"
_PING, _READ, _WRITE, _SYNC_READ, _SYNC_WRITE = 0x01, 0x02, 0x03, 0x82, 0x83
_BROADCAST = 0xFE
_BAD_INSTRUCTION = 0x40
#: Grip force at full torque, at which the servo yields (2.9 N m on a jaw of 70 mm).
_FULL_FORCE_N = 41.0
_FASTEST = 3400
_TABLE_SIZE = 87
#: Settings of a new servo.
_FACTORY = {
    sts.RESPONSE_LEVEL: 1,
    sts.MAX_POSITION_LIMIT: sts.TICKS - 1,
    sts.MAX_VOLTAGE_LIMIT: 80,
    sts.MIN_VOLTAGE_LIMIT: 40,
    sts.MAX_TORQUE_LIMIT: sts.FULL_TORQUE,
    sts.TORQUE_LIMIT: sts.FULL_TORQUE,
    sts.PHASE: 12,
    sts.PRESENT_VOLTAGE: 74,
    sts.PRESENT_TEMPERATURE: 29,
}


def checksum(body: bytes) -> int:
    """Return the checksum of a packet's bytes after the header.

    Examples
    --------
    The manual's ping of servo 1:

    >>> hex(checksum(bytes([1, 2, 1])))
    '0xfb'
    """
    return ~sum(body) & 0xFF


class ArmServo:
    """A servo of an arm: it moves to its goal at its goal velocity, without a load.

    `tick`: position at the start.
    """

    def __init__(self, *, model_number: int = 777, tick: int = sts.TICKS // 2) -> None:
        self._table = bytearray(_TABLE_SIZE)
        stored = {sts.MODEL_NUMBER: model_number, **_FACTORY, sts.GOAL_POSITION: tick}
        for register, value in stored.items():
            self._put(register, value)
        self._tick, self._now_s = float(tick), 0.0

    def read(self, address: int, size: int, *, now_s: float) -> bytes:
        """Return registers at a time, seconds."""
        self._update(now_s)
        return bytes(self._table[address : address + size])

    def write(self, address: int, data: bytes, *, now_s: float) -> None:
        """Write registers at a time, seconds."""
        self._update(now_s)
        self._table[address : address + len(data)] = data

    def _update(self, now_s: float) -> None:
        elapsed_s, self._now_s = now_s - self._now_s, now_s
        left = self._get(sts.GOAL_POSITION) - self._tick
        if self._get(sts.TORQUE_ENABLE):
            largest = (self._get(sts.GOAL_VELOCITY) or _FASTEST) * elapsed_s
            self._tick += min(max(left, -largest), largest)
        self._put(sts.PRESENT_POSITION, round(self._tick))
        self._put(sts.MOVING, bool(self._get(sts.TORQUE_ENABLE) and abs(left) >= 1.0))

    def _get(self, register: Register) -> int:
        return register.decode(
            bytes(self._table[register.address : register.address + register.size])
        )

    def _put(self, register: Register, value: int) -> None:
        self._table[register.address : register.address + register.size] = register.encode(
            int(value)
        )


class StsBus(SimulatedServo):
    """A Feetech servo with a jaw, and the servos of an arm on the same line.

    `jaw`: converts the servo angle to the width. `closed_tick`: position at which the pads touch;
    positions increase as the jaw opens.

    `arm`: the other servos by their numbers.

    `state`: protection states, reported in every reply.
    `clips_to`: range to which goals are shortened, in their register too, whatever the stored
        limits are.
    """

    def __init__(
        self,
        world: World,
        *,
        jaw: HingedJaw,
        closed_tick: int,
        servo_id: int = 6,
        model_number: int = 777,
        arm: Mapping[int, ArmServo] = MappingProxyType({}),
    ) -> None:
        self._arm = arm
        self._jaw, self._closed, self._id = jaw, closed_tick, servo_id
        self.state = sts.State(0)
        self.clips_to: tuple[int, int] | None = None
        self._is_closing = False
        stored = {sts.MODEL_NUMBER: model_number, **_FACTORY}
        super().__init__(world, size=_TABLE_SIZE, stored=stored)

    # -- the line ---------------------------------------------------------------------------------

    def _receive(self, waiting: bytes) -> bytes:
        while (begin := waiting.find(_HEADER)) >= 0 and len(waiting) >= begin + 4:
            end = begin + 4 + waiting[begin + 3]
            if len(waiting) < end:
                break
            body, waiting = waiting[begin + 2 : end], waiting[end:]
            self._handle_packet(body)
        return waiting

    def _handle_packet(self, body: bytes) -> None:
        if checksum(body[:-1]) != body[-1]:
            return
        number, instruction, given = body[0], body[2], body[3:-1]
        if instruction == _SYNC_READ:
            for one in given[2:]:
                self._execute(one, _READ, given[:2])
        elif instruction == _SYNC_WRITE:
            address, size = given[:2]
            for start in range(2, len(given), size + 1):
                data = given[start + 1 : start + 1 + size]
                self._execute(given[start], _WRITE, bytes([address]) + data, answers=False)
        elif number == _BROADCAST and instruction == _PING:
            for one in sorted({*self._arm, self._id}):
                self._execute(one, _PING, b"")
        else:
            self._execute(number, instruction, given)

    def _execute(
        self, number: int, instruction: int, given: bytes, *, answers: bool = True
    ) -> None:
        with self.lock:
            if number in self._arm:
                self._execute_arm(number, instruction, given, answers=answers)
            elif number == self._id and not self.silent:
                self._execute_jaw(instruction, given, answers=answers)

    def _execute_arm(self, number: int, instruction: int, given: bytes, *, answers: bool) -> None:
        servo, now_s, data = self._arm[number], self._world.clock.now_s(), b""
        if instruction == _READ:
            data = servo.read(given[0], given[1], now_s=now_s)
        elif instruction == _WRITE:
            servo.write(given[0], given[1:], now_s=now_s)
        if answers:
            known = instruction in (_PING, _READ, _WRITE)
            self._send(number, data, error=0 if known else _BAD_INSTRUCTION)

    def _execute_jaw(self, instruction: int, given: bytes, *, answers: bool) -> None:
        self.packets += 1
        self._update(self._world.clock.now_s())
        if instruction == _PING:
            self._reply()
        elif instruction == _READ:
            self._refresh()
            self._reply(bytes(self._table[given[0] : given[0] + given[1]]))
        elif instruction == _WRITE:
            written = range(given[0], given[0] + len(given) - 1)
            if not any(register.address in written for register in self.failing_registers):
                self._table[written.start : written.stop] = given[1:]
            # With torque on, the servo moves to its present goal.
            if {sts.GOAL_POSITION.address, sts.TORQUE_ENABLE.address} & set(written):
                self._move()
            if answers and self._get(sts.RESPONSE_LEVEL):
                self._reply()
        else:
            self._reply(error=_BAD_INSTRUCTION)

    def _reply(self, data: bytes = b"", *, error: int = 0) -> None:
        self._send(self._id, data, error=error | self.state)

    def _send(self, number: int, data: bytes, *, error: int) -> None:
        body = bytes([number, len(data) + 2, error]) + data
        check = checksum(body)
        if self.damaged_replies:
            self.damaged_replies, check = self.damaged_replies - 1, check ^ 1
        self._line.send(_HEADER + body + bytes([check]), late_s=self.late_s)

    # -- the servo --------------------------------------------------------------------------------

    def _move(self) -> None:
        if not self._get(sts.TORQUE_ENABLE):
            return
        goal = self._get(sts.GOAL_POSITION)
        if self.clips_to is not None:
            goal = min(max(goal, self.clips_to[0]), self.clips_to[1])
            self._put(sts.GOAL_POSITION, goal)
        low, high = self._get(sts.MIN_POSITION_LIMIT), self._get(sts.MAX_POSITION_LIMIT)
        if low or high:
            goal = min(max(goal, low), high)
        goal += self._get(sts.HOMING_OFFSET) - self.position_error - self._closed
        # The jaw is stopped by its mate, and at half a turn.
        goal = min(max(goal, 0), sts.TICKS // 2)
        target_mm = self._jaw.width_mm(goal * sts.RAD_PER_TICK)
        now_mm = self._world.drive_value(self._world.clock.now_s())
        turn = abs(goal - self._jaw.angle_rad(now_mm) / sts.RAD_PER_TICK)
        velocity = self._get(sts.GOAL_VELOCITY) or _FASTEST
        if not self._get(sts.PHASE) & sts.Phase.FINE_VELOCITY:
            velocity = min(50 * velocity, _FASTEST)
        self._is_closing = target_mm < now_mm
        if abs(target_mm - now_mm) > 1e-9:
            rate = abs(target_mm - now_mm) / turn * velocity
            self._hand.command(GripperCommand(target=target_mm, rate=rate))

    def _refresh(self) -> None:
        state = self._hand.state()
        width_mm = self._world.drive_value(self._world.clock.now_s())
        turned = round(self._jaw.angle_rad(width_mm) / sts.RAD_PER_TICK)
        position = self._closed + turned + self.position_error - self._get(sts.HOMING_OFFSET)
        if not self._get(sts.PHASE) & sts.Phase.COUNTS_TURNS:
            position %= sts.TICKS
        self._put(sts.PRESENT_POSITION, position)
        self._put(sts.PRESENT_CURRENT, round(abs(state.current_ma) / sts.MA_PER_UNIT))
        self._put(sts.MOVING, state.moving)

    def _step(self, time_s: float) -> None:
        """Stop at the torque limit."""
        limit_n = _FULL_FORCE_N * self._get(sts.TORQUE_LIMIT) / sts.FULL_TORQUE
        is_closing = self._is_closing and self._world.is_moving(time_s)
        is_current = time_s >= self._world.clock.now_s()
        if is_current and is_closing and self._world.force_n(time_s) > limit_n:
            self._world.halt(time_s=time_s)
