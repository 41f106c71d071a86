"""A simulated Feetech STS3215 servo on a pseudo-terminal, which moves the twin's fingers.

The servo implements its protocol manual: checksums, state bits in every reply, sign-magnitude
values. It has no watchdog, and moves to its goal without a host. Goals beyond its stored angle
limits are shortened without an error. With one bit of its phase it counts turns, without another
its velocities count 50 steps each. The torque limit is checked only when the world is read, and is
converted to a force with a linear law.
"""

from __future__ import annotations

import threading

from tests.contract.servo_bus import LineEnd

from palpate.gripper import sts_series as sts
from palpate.gripper.fingers import HingedJaw
from palpate.gripper.interface import GripperCommand
from palpate.gripper.packets import Register
from palpate.twin.devices import TwinGripper
from palpate.twin.world import World

_HEADER = b"\xff\xff"
_PING, _READ, _WRITE = 0x01, 0x02, 0x03
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


class StsBus:
    """One servo on a line; the host opens the port `name`.

    Parameters
    ----------
    world : World
        World with the fingers to move.
    jaw : HingedJaw
        Converts the servo angle to the width.
    closed_tick : int
        Position at which the pads touch; positions increase as the jaw opens.
    servo_id, model_number : int
        Identity of the servo.

    Attributes
    ----------
    silent : bool
        Whether the servo ignores all requests.
    damaged_replies : int
        Number of following replies with a wrong checksum.
    state : State
        Protection states, reported in every reply.
    failing_registers : set of Register
        Registers whose writes are acknowledged but not stored.
    late_s : float
        Delay of the replies in real time, seconds.
    position_error : int
        Difference of the positions on the line from those of the jaw, steps.
    clips_to : (int, int), optional
        Range to which goals are shortened, in their register too, whatever the stored limits are.
    packets : int
        Number of requests received.
    """

    def __init__(
        self,
        world: World,
        *,
        jaw: HingedJaw,
        closed_tick: int,
        servo_id: int = 6,
        model_number: int = 777,
    ) -> None:
        self._world, self._hand, self._jaw = world, TwinGripper(world), jaw
        self._closed, self._id = closed_tick, servo_id
        self.silent, self.damaged_replies, self.state = False, 0, sts.State(0)
        self.failing_registers, self.packets = set[Register](), 0
        self.late_s, self.position_error = 0.0, 0
        self.clips_to: tuple[int, int] | None = None
        self._table = bytearray(_TABLE_SIZE)
        self._put(sts.MODEL_NUMBER, model_number)
        for register, value in _FACTORY.items():
            self._put(register, value)
        self._put(sts.TORQUE_LIMIT, self._get(sts.MAX_TORQUE_LIMIT))
        self._is_closing = False
        self._lock, self._is_updating = threading.RLock(), False
        world.watchers.insert(0, self._update)
        self._line = LineEnd(self._receive)
        self.name = self._line.name

    def value(self, register: Register) -> int:
        """Return the value of a register, without using the line."""
        with self._lock:
            return self._get(register)

    def set(self, register: Register, value: int) -> None:
        """Set a register, as an earlier host would have."""
        with self._lock:
            self._put(register, value)

    def unplug(self) -> None:
        """Unplug the adapter, with the servo still powered; repeatable."""
        self._line.unplug()

    def close(self) -> None:
        """Remove the servo and its line; repeatable."""
        self.unplug()
        if self._update in self._world.watchers:
            self._world.watchers.remove(self._update)

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
        is_valid = checksum(body[:-1]) == body[-1]
        if body[0] != self._id or self.silent or not is_valid:
            return
        with self._lock:
            self.packets += 1
            self._update(self._world.clock.now_s())
            instruction, given = body[2], body[3:-1]
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
                if self._get(sts.RESPONSE_LEVEL):
                    self._reply()
            else:
                self._reply(error=_BAD_INSTRUCTION)

    def _reply(self, data: bytes = b"", *, error: int = 0) -> None:
        body = bytes([self._id, len(data) + 2, error | self.state]) + data
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

    def _update(self, time_s: float) -> None:
        """Update the servo: stop it at its torque limit."""
        with self._lock:
            if self._is_updating or time_s < self._world.clock.now_s():
                return
            self._is_updating = True
            try:
                limit_n = _FULL_FORCE_N * self._get(sts.TORQUE_LIMIT) / sts.FULL_TORQUE
                is_closing = self._is_closing and self._world.is_moving(time_s)
                if is_closing and self._world.force_n(time_s) > limit_n:
                    self._world.halt(time_s=time_s)
            finally:
                self._is_updating = False

    def _get(self, register: Register) -> int:
        run = self._table[register.address : register.address + register.size]
        return register.decode(bytes(run))

    def _put(self, register: Register, value: int) -> None:
        end = register.address + register.size
        self._table[register.address : end] = register.encode(int(value))
