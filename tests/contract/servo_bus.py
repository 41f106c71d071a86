"""A simulated DYNAMIXEL X-series servo on a pseudo-terminal, which moves the twin's fingers.

The servo implements Protocol 2.0 according to the e-Manual: status packets with CRC-16, error
codes, memory locked while the torque is on, bus watchdog, hardware errors cleared only by a reboot,
the sign of the current, and drive modes; the stored shift of the positions, which position mode
ignores beyond a quarter turn; stored limits of position (used by position mode only) and velocity,
beyond which a goal is refused; turns, which position mode drops when the torque is switched on; and
the errors that switch the torque off. Two simplifications: fingers without torque keep their
position, and the current limit is checked only when the world is read.
"""

from __future__ import annotations

import math

from palpate.gripper import x_series as x
from palpate.gripper.fingers import CrankFingers
from palpate.gripper.interface import GripperCommand
from palpate.gripper.packets import PROTOCOL_2, Register, RegisterBlock
from palpate.twin.simulated_servo import SimulatedServo
from palpate.twin.world import World

_HEADER = b"\xff\xff\xfd\x00"
_PING, _READ, _WRITE, _REBOOT, _STATUS = 0x01, 0x02, 0x03, 0x08, 0x55
_GOALS = (x.GOAL_PWM, x.GOAL_CURRENT, x.GOAL_POSITION, x.PROFILE_VELOCITY)
#: Positions to which the modes with several turns can go, and the largest shift in position mode.
_MAX_TURNED, _MAX_SHIFT = 1_048_575, 1024
#: End of the EEPROM, which can be written only while the torque is off.
_EEPROM_END = 64
#: Default profile velocity, in the servo's units.
_FASTEST = 200


def crc16(data: bytes) -> int:
    """Return the CRC-16 of Protocol 2.0 (polynomial 0x8005, from 0, highest bit first).

    >>> hex(crc16(bytes.fromhex("fffffd0001030001")))
    '0x4e19'
    """
    crc = 0
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x8005 if crc & 0x8000 else crc << 1
        crc &= 0xFFFF
    return crc


#: Settings of a new servo.
_FACTORY = {
    x.OPERATING_MODE: x.Mode.POSITION,
    x.PWM_LIMIT: x.FULL_PWM,
    x.CURRENT_LIMIT: 1193,
    x.VELOCITY_LIMIT: 350,
    x.MAX_POSITION_LIMIT: x.TICKS - 1,
    x.SHUTDOWN: 0x34,
    x.MAX_VOLTAGE_LIMIT: 160,
    x.MIN_VOLTAGE_LIMIT: 95,
    x.PRESENT_VOLTAGE: 120,
    x.PRESENT_TEMPERATURE: 31,
}


class ServoBus(SimulatedServo):
    """A DYNAMIXEL servo.

    `cut_at`: number of bytes to which each reply is truncated; None for complete replies.
    `ignores_goals`: whether new position goals are acknowledged but not executed.
    """

    def __init__(
        self,
        world: World,
        *,
        model_number: int = 1020,
        servo_id: int = 9,
        fingers: CrankFingers | None = None,
    ) -> None:
        self._fingers, self._id = fingers or CrankFingers(), servo_id
        self.cut_at: int | None = None
        self.ignores_goals, self._last_packet_s = False, world.clock.now_s()
        super().__init__(world, size=x.STATE[1], stored={x.MODEL_NUMBER: model_number, **_FACTORY})
        self._start()

    def fail(self, error: x.HardwareError) -> None:
        """Set a hardware error; one of those in the shutdown register switches the torque off.

        Without an error, the torque is lost all the same.
        """
        with self.lock:
            self._put(x.HARDWARE_ERROR, error)
            if not error or error & self._get(x.SHUTDOWN):
                self._put(x.TORQUE_ENABLE, 0)
                self._world.halt()

    # -- the line ---------------------------------------------------------------------------------

    def _receive(self, waiting: bytes) -> bytes:
        while (begin := waiting.find(_HEADER)) >= 0 and len(waiting) >= begin + 7:
            end = begin + 7 + int.from_bytes(waiting[begin + 5 : begin + 7], "little")
            if len(waiting) < end:
                break
            packet, waiting = waiting[begin:end], waiting[end:]
            self._handle_packet(packet)
        return waiting

    def _handle_packet(self, packet: bytes) -> None:
        if packet[4] != self._id or self.silent:
            return
        with self.lock:
            self.packets += 1
            self._update(self._world.clock.now_s())
            self._last_packet_s = self._world.clock.now_s()
            if crc16(packet[:-2]) != int.from_bytes(packet[-2:], "little"):
                self._reply(x.PacketError.CRC)
                return
            body = packet[7:-2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
            self._execute(body[0], body[1:])

    def _execute(self, instruction: int, given: bytes) -> None:
        if instruction == _PING:
            self._reply(0, bytes(self._table[0:2]) + b"\x2d")
        elif instruction == _READ:
            begin, size = int.from_bytes(given[0:2], "little"), int.from_bytes(given[2:4], "little")
            self._refresh()
            if self._get(x.STATUS_RETURN_LEVEL):
                self._reply(0, bytes(self._table[begin : begin + size]))
        elif instruction == _WRITE:
            error = self._write_table(int.from_bytes(given[0:2], "little"), given[2:])
            if self._get(x.STATUS_RETURN_LEVEL) == x.ALL_REPLIES:
                self._reply(error)
        elif instruction == _REBOOT:
            self._reply(0)
            self._start()
        else:
            self._reply(x.PacketError.INSTRUCTION)

    def _reply(self, error: int, data: bytes = b"") -> None:
        alert = PROTOCOL_2.alert_mask if self._get(x.HARDWARE_ERROR) else 0
        body = (bytes([_STATUS, error | alert]) + data).replace(
            b"\xff\xff\xfd", b"\xff\xff\xfd\xfd"
        )
        packet = _HEADER + bytes([self._id]) + (len(body) + 2).to_bytes(2, "little") + body
        crc = crc16(packet)
        if self.damaged_replies:
            self.damaged_replies, crc = self.damaged_replies - 1, crc ^ 1
        packet += crc.to_bytes(2, "little")
        self._line.send(packet[: self.cut_at], late_s=self.late_s)

    # -- the servo --------------------------------------------------------------------------------

    def _start(self) -> None:
        for register in (x.HARDWARE_ERROR, x.TORQUE_ENABLE, x.BUS_WATCHDOG, x.PROFILE_VELOCITY):
            self._put(register, 0)
        self._put(x.STATUS_RETURN_LEVEL, x.ALL_REPLIES)
        self._drop_turns()
        self._put(x.GOAL_PWM, self._get(x.PWM_LIMIT))
        self._put(x.GOAL_CURRENT, self._get(x.CURRENT_LIMIT))

    def _write_table(self, address: int, data: bytes) -> int:
        """Write to the table; return the error code."""
        block = RegisterBlock(address, data)

        def contains(register: Register) -> bool:
            return address <= register.address < address + len(data)

        locked = address < _EEPROM_END and self._get(x.TORQUE_ENABLE)
        failed = contains(x.TORQUE_ENABLE) and self._get(x.HARDWARE_ERROR)
        if locked or failed:
            return x.PacketError.ACCESS
        if any(map(contains, _GOALS)) and self._get(x.BUS_WATCHDOG) < 0:
            return x.PacketError.DATA_RANGE
        is_fast = contains(x.PROFILE_VELOCITY) and not self._is_time_based()
        if is_fast and block.value(x.PROFILE_VELOCITY) > self._get(x.VELOCITY_LIMIT):
            return x.PacketError.DATA_LIMIT
        if contains(x.GOAL_POSITION):
            low, high = self._goal_limits()
            if not low <= block.value(x.GOAL_POSITION) <= high:
                return x.PacketError.DATA_LIMIT
        if not any(map(contains, self.failing_registers)):
            self._table[address : address + len(data)] = data
        if contains(x.TORQUE_ENABLE) and self._is_single_turn():
            self._drop_turns()
        if contains(x.GOAL_POSITION) and not self.ignores_goals:
            self._move()
        return 0

    def _drop_turns(self) -> None:
        self.position_error = (self.position_error + x.TICKS // 2) % x.TICKS - x.TICKS // 2

    def _is_single_turn(self) -> bool:
        return self._get(x.OPERATING_MODE) == x.Mode.POSITION

    def _is_time_based(self) -> bool:
        return bool(self._get(x.DRIVE_MODE) & x.TIME_BASED)

    def _goal_limits(self) -> tuple[int, int]:
        if self._is_single_turn():
            return self._get(x.MIN_POSITION_LIMIT), self._get(x.MAX_POSITION_LIMIT)
        return -_MAX_TURNED, _MAX_TURNED

    def _shift(self) -> int:
        """Return the difference of the positions on the line from those of the mechanism."""
        stored = self._get(x.HOMING_OFFSET)
        is_used = not self._is_single_turn() or abs(stored) <= _MAX_SHIFT
        return self.position_error + (stored if is_used else 0)

    def _move(self) -> None:
        if not self._get(x.TORQUE_ENABLE):
            return
        turned = self._get(x.GOAL_POSITION) - x.CENTRE_TICK - self._shift()
        # Fingers at the end of the mechanism block the servo.
        goal_rad = self._direction() * turned * x.RAD_PER_TICK
        goal_rad = min(max(goal_rad, -math.pi / 2), math.pi / 2)
        target_mm = self._fingers.width_mm(goal_rad)
        now_mm = self._world.drive_value(self._world.clock.now_s())
        velocity = self._get(x.PROFILE_VELOCITY) or _FASTEST
        turn_rad = abs(goal_rad - self._fingers.angle_rad(now_mm))
        travel_mm = abs(target_mm - now_mm)
        if travel_mm > 1e-9:
            duration_s = turn_rad / (velocity * x.RAD_PER_S_PER_VELOCITY)
            if self._is_time_based():
                duration_s = max(self._get(x.PROFILE_VELOCITY), 1) / 1e3
            self._hand.command(GripperCommand(target=target_mm, rate=travel_mm / duration_s))

    def _direction(self) -> int:
        """Return 1 if positions increase as the fingers open, -1 in reverse mode."""
        return -1 if self._get(x.DRIVE_MODE) & x.REVERSE else 1

    def _refresh(self) -> None:
        state, unit = self._hand.state(), x.MODELS[self._get(x.MODEL_NUMBER)].ma_per_unit
        width_mm = self._world.drive_value(self._world.clock.now_s())
        self._put(x.MOVING, state.moving)
        self._put(x.MOVING_STATUS, x.PROFILE_ONGOING if state.moving else 1)
        # The twin's current is positive for closing, which is towards smaller positions.
        current = 0 if unit is None else -self._direction() * round(state.current_ma / unit)
        self._put(x.PRESENT_CURRENT, current)
        turned = self._direction() * round(self._fingers.angle_rad(width_mm) / x.RAD_PER_TICK)
        self._put(x.PRESENT_POSITION, x.CENTRE_TICK + turned + self._shift())

    def _step(self, time_s: float) -> None:
        """Stop at a watchdog timeout or at the current limit."""
        if not self._get(x.TORQUE_ENABLE):
            return
        watchdog_s = self._get(x.BUS_WATCHDOG) * x.WATCHDOG_STEP_S
        if watchdog_s > 0 and time_s > self._last_packet_s + watchdog_s:
            self._put(x.BUS_WATCHDOG, -1)
            self._world.halt(time_s=time_s)
        unit = x.MODELS[self._get(x.MODEL_NUMBER)].ma_per_unit
        if unit is None or time_s < self._world.clock.now_s() or not self._world.is_moving(time_s):
            return
        if self._hand.state().current_ma > self._get(x.GOAL_CURRENT) * unit:
            self._world.halt(time_s=time_s)
