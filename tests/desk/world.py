"""The world of the desk: an object, fingers, a board and a hand, stepped by the wall clock.

``python -m tests.desk.world JSON`` with the fields of `Desk`. It prints its ports as one line of
JSON, obeys the lines of its standard input (``place SEED``, ``report``), answers each with a line,
and ends with its input. The log has a record of `LOG` every 5 ms.
"""

from __future__ import annotations

import gc
import json
import os
import select
import struct
import sys
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TypedDict

import numpy as np
from tests.contract.hands import TRAVEL
from tests.desk.board_ends import (
    Adapter,
    BoardEnd,
    OwnFirmware,
    PortProbe,
    Streamer,
    encode_flexitac,
    encode_text,
)
from tests.desk.hand_ends import open_hand_end

from palpate.clock import ManualClock
from palpate.sensor.array import RIGID_LAYOUT, ArrayLayout
from palpate.signal.circuit import Divider
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.world import OPEN_MM, World

#: Seed of the sheet and the hand of the desk, which its calibrations belong to.
SHEET_SEED = 5
#: The target is that of the last movement, in which the hand may have stopped since.
LOG = np.dtype([("monotonic_s", "f8"), ("width_mm", "f8"), ("force_n", "f8"), ("target_mm", "f8")])
_RECORD = struct.Struct("4d")
#: Intervals of the log, and of the steps: about that of the packets on a USB line.
_LOG_S, _STEP_S = 0.005, 0.002
#: Objects that can be 32 mm thick, which the desk makes them.
OBJECTS, SIZE_MM = ("strawberry", "banana"), 32.0
#: Counts of the paper's array and of a FlexiTac pad; its pixels are 3 mm apart (guess).
FLEXITAC = ArrayLayout(
    name="flexitac-12x32",
    rows=12,
    cols=32,
    finger_of_row=(0,) * 12,
    divider=Divider(reference_ohm=1000.0, adc_bits=8),
)
_FLEXITAC_PITCH_MM = 3.0
_BAUD = {"text": 115_200, "flexitac": 2_000_000}
_LATE_S = 0.005


class Report(TypedDict):
    """The true values of the object, and the delays and costs of the world."""

    #: Largest force on the object, and whether it was damaged.
    peak_n: float
    damaged: bool
    #: Opening of the fingers.
    width_mm: float
    #: Largest delay of a step against the wall clock, steps later than 5 ms, and CPU time over
    #: elapsed time.
    latest_s: float
    late_steps: int
    cpu_fraction: float
    #: Largest delay of a byte in the kernel (`PortProbe`).
    port_latest_s: float
    #: Bytes of the board for which the port had no room.
    overflow_bytes: int


@dataclass(frozen=True, kw_only=True)
class Desk:
    """What stands on the desk.

    `board`: "firmware", "text" or "flexitac". `hand`: "dynamixel", "feetech", "servo" (on the
    board) or "own". `seed`: object, its place and all noise. `reply_s`: delay of the hand's
    replies. `burst_s`: timer of the board's adapter. `log`: path of the log.
    """

    board: str
    rate_hz: float
    hand: str
    seed: int
    reply_s: float
    burst_s: float
    log: str

    def as_text(self) -> str:
        """Return the argument of the world's process."""
        return json.dumps(asdict(self))


def layout_of(board: str) -> ArrayLayout:
    """Return the layout of a board's frames."""
    return FLEXITAC if board == "flexitac" else RIGID_LAYOUT


def sheet_layout(board: str) -> ArrayLayout:
    """Return the layout with the true distances of its pixels."""
    layout = layout_of(board)
    return replace(layout, pitch_mm=_FLEXITAC_PITCH_MM) if board == "flexitac" else layout


def draw_desk_object(seed: int) -> TwinObject:
    """Return the object of a seed."""
    rng = np.random.default_rng([seed, 10])
    return replace(draw_object(rng, str(rng.choice(OBJECTS))), size_mm=SIZE_MM)


class LoggedWorld(World):
    """A world that remembers its last command."""

    target_mm = OPEN_MM

    def drive(self, target: float, *, rate: float, time_s: float | None = None) -> float:
        self.target_mm = target
        return super().drive(target, rate=rate, time_s=time_s)


class DeskWorld:
    """The running world; threads of the hands use it under its lock."""

    def __init__(self, desk: Desk) -> None:
        self._start_s = time.monotonic()
        self._lock = threading.RLock()
        self._clock = ManualClock()
        self._world = LoggedWorld(
            draw_desk_object(desk.seed),
            seed=desk.seed,
            sheet_seed=SHEET_SEED,
            layout=sheet_layout(desk.board),
            frame_rate_hz=desk.rate_hz,
            clock=self._clock,
        )
        self._adapter = Adapter(self._make_board(desk), burst_s=desk.burst_s)
        self._probe = PortProbe()
        self._hand = open_hand_end(desk.hand, self._world, lock=self._lock, late_s=desk.reply_s)
        self.ports = {"board": self._adapter.name, "hand": self._hand and self._hand.name}
        self._log = Path(desk.log).open("wb")  # noqa: SIM115
        self._logged_s = self._latest_s = 0.0
        self._late_steps, self._cpu_start_s = 0, time.process_time()

    def run(self) -> None:
        """Run until the standard input ends."""
        due_s, typed = 0.0, b""
        while True:
            late_s = self._elapsed_s() - due_s
            # The start of the process is not a delay of the world.
            if due_s > 1.0:
                self._latest_s = max(self._latest_s, late_s)
                self._late_steps += late_s > _LATE_S
            with self._lock:
                self._step_to(self._elapsed_s())
            due_s = max(due_s + _STEP_S, self._elapsed_s())
            wait_s = max(due_s - self._elapsed_s(), 0.0)
            if select.select([sys.stdin], [], [], wait_s)[0]:
                if not (read := os.read(sys.stdin.fileno(), 4096)):
                    return
                *lines, typed = (typed + read).split(b"\n")
                for line in lines:
                    with self._lock:
                        print(json.dumps(self._obey(line.decode().split())), flush=True)

    def _make_board(self, desk: Desk) -> BoardEnd:
        if desk.board == "firmware":
            travel = TRAVEL if desk.hand == "servo" else None
            return OwnFirmware(self._world, seed=desk.seed, travel=travel)
        encode = encode_text if desk.board == "text" else encode_flexitac
        return Streamer(self._world, baud=_BAUD[desk.board], encode=encode)

    def _elapsed_s(self) -> float:
        return time.monotonic() - self._start_s

    def _step_to(self, until_s: float) -> None:
        while self._logged_s + _LOG_S <= until_s:
            self._logged_s += _LOG_S
            self._set_clock(self._logged_s)
            width_mm = self._world.drive_value(self._logged_s)
            force_n = self._world.force_n(self._logged_s)
            time_s, target_mm = self._start_s + self._logged_s, self._world.target_mm
            self._log.write(_RECORD.pack(time_s, width_mm, force_n, target_mm))
        self._set_clock(until_s)
        self._adapter.exchange(until_s)
        self._probe.look(until_s)

    def _set_clock(self, time_s: float) -> None:
        self._clock.sleep_s(max(time_s - self._clock.now_s(), 0.0))

    def _obey(self, words: list[str]) -> object:
        if words[0] == "place":
            try:
                self._world.place(None)
                self._world.place(draw_desk_object(int(words[1])))
            except ValueError as error:
                return str(error)
            return "placed"
        self._log.flush()
        truth = self._world.truth()
        latest_s, late_steps, self._latest_s, self._late_steps = (
            self._latest_s, self._late_steps, 0.0, 0
        )  # fmt: skip
        port_latest_s, self._probe.latest_s = self._probe.latest_s, 0.0
        return Report(
            peak_n=truth.peak_force_n,
            damaged=truth.damaged,
            width_mm=self._world.drive_value(self._clock.now_s()),
            latest_s=latest_s,
            late_steps=late_steps,
            cpu_fraction=(time.process_time() - self._cpu_start_s) / self._elapsed_s(),
            port_latest_s=port_latest_s,
            overflow_bytes=self._adapter.overflow_bytes,
        )


def main() -> None:
    """Run the world of the argument."""
    # A real world is never late because a computer is busy. The threads of the hands inherit this.
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    world = DeskWorld(Desk(**json.loads(sys.argv[1])))
    gc.freeze()
    print(json.dumps(world.ports), flush=True)
    world.run()


if __name__ == "__main__":
    main()
