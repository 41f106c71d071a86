"""A simulated bus servo on a pseudo-terminal, which moves the twin's fingers: its registers.

Subclasses implement a protocol and a servo.
"""

from __future__ import annotations

import threading

from palpate.gripper.packets import Register
from palpate.twin.devices import TwinGripper
from palpate.twin.line_end import LineEnd
from palpate.twin.world import World


class SimulatedServo:
    """One servo on a line; the host opens the port `name`.

    The servo answers from its own thread. Runs are repeatable if one host thread advances the clock
    and waits for each answer.

    `silent`: whether the servo ignores all requests.
    `damaged_replies`: number of following replies with a wrong checksum.
    `late_s`: delay of the replies in real time, seconds; they keep their order. With `inf` requests
        are executed without a reply.
    `position_error`: difference of the positions on the line, reported and commanded, from those of
        a horn mounted at its right angle, steps.
    `packets`: number of requests received.
    `lock`: guards the world against the servo's thread.
    `failing_registers`: registers whose writes are acknowledged but not stored.
    """

    def __init__(self, world: World, *, size: int, stored: dict[Register, int]) -> None:
        self._world, self._hand = world, TwinGripper(world)
        self.silent, self.damaged_replies = False, 0
        self.late_s, self.position_error = 0.0, 0
        self.failing_registers, self.packets = set[Register](), 0
        self._table = bytearray(size)
        for register, value in stored.items():
            self._put(register, value)
        self.lock, self._is_updating = threading.RLock(), False
        world.watchers.insert(0, self._update)
        self._line = LineEnd(self._receive)
        self.name = self._line.name

    def value(self, register: Register) -> int:
        """Return the value of a register, without using the line."""
        with self.lock:
            return self._get(register)

    def set(self, register: Register, value: int) -> None:
        """Set a register, as an earlier host would have."""
        with self.lock:
            self._put(register, value)

    def unplug(self) -> None:
        """Unplug the adapter, with the servo still powered; repeatable."""
        self._line.unplug()

    def close(self) -> None:
        """Remove the servo and its line; repeatable."""
        self.unplug()
        if self._update in self._world.watchers:
            self._world.watchers.remove(self._update)

    def _receive(self, waiting: bytes) -> bytes:
        """Execute complete packets; return the rest."""
        raise NotImplementedError

    def _step(self, time_s: float) -> None:
        """Stop the servo where it stops by itself."""
        raise NotImplementedError

    def _update(self, time_s: float) -> None:
        with self.lock:
            if self._is_updating:
                return
            self._is_updating = True
            try:
                self._step(time_s)
            finally:
                self._is_updating = False

    def _get(self, register: Register) -> int:
        end = register.address + register.size
        return register.decode(bytes(self._table[register.address : end]))

    def _put(self, register: Register, value: int) -> None:
        end = register.address + register.size
        self._table[register.address : end] = register.encode(int(value))
