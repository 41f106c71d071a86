"""The hands of the desk: the device ends of their lines, which move the fingers of the world."""

from __future__ import annotations

import threading

from tests.contract.hands import CLOSED_TICK, JAW
from tests.contract.servo_bus import ServoBus

from palpate.gripper.interface import GripperCommand
from palpate.twin.devices import TwinGripper
from palpate.twin.line_end import LineEnd
from palpate.twin.sts_bus import StsBus
from palpate.twin.world import World


class OwnHandEnd:
    """The device of `own_hand`: answers ``get`` and ``set WIDTH SPEED``."""

    def __init__(self, world: World, *, lock: threading.RLock, late_s: float) -> None:
        self._world, self._hand, self._lock, self._late_s = world, TwinGripper(world), lock, late_s
        self._line = LineEnd(self._receive)
        self.name = self._line.name

    def _receive(self, waiting: bytes) -> bytes:
        *lines, rest = waiting.split(b"\n")
        for line in lines:
            with self._lock:
                self._line.send(self._answer(line.decode().split()), late_s=self._late_s)
        return rest

    def _answer(self, words: list[str]) -> bytes:
        if words[0] == "get":
            return b"%.2f\n" % self._world.drive_value(self._world.now_s())
        self._hand.command(GripperCommand(target=float(words[1]), rate=float(words[2])))
        return b"ok\n"


def open_hand_end(
    kind: str, world: World, *, lock: threading.RLock, late_s: float
) -> ServoBus | StsBus | OwnHandEnd | None:
    """Return the device of a hand; None for a servo on the board."""
    if kind == "servo":
        return None
    if kind == "own":
        return OwnHandEnd(world, lock=lock, late_s=late_s)
    bus: ServoBus | StsBus
    if kind == "dynamixel":
        bus = ServoBus(world)
    else:
        bus = StsBus(world, jaw=JAW, closed_tick=CLOSED_TICK)
    # Its own lock guards a world that nobody else advances.
    bus.lock, bus.late_s = lock, late_s
    return bus
