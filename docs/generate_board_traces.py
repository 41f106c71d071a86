"""Draw a Mega's safe line and servo pulses during faults, on the AVR simulator.

    python docs/generate_board_traces.py

Needs `make -C firmware`, `make -C firmware/sim` and Debian's arduino-core-avr (the bootloader).
"""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from palpate.sensor.wire import encode_command
from palpate.sensor.wire_messages import (
    Command,
    Ping,
    SetCeiling,
    SetServo,
    SetServoTravel,
    Start,
)
from palpate.twin.firmware import FirmwareBoard

OUT = Path(__file__).resolve().parent / "images" / "board-traces.svg"
BOOTLOADER = Path(
    "/usr/share/arduino/hardware/arduino/avr/bootloaders/stk500v2/stk500boot_v2_mega2560.hex"
)
_STEP_S = 0.005
#: Events of the trace: start in seconds, and label.
EVENTS = (
    (0.0, "power-up"),
    (1.5, "port opened"),
    (3.0, "armed,\nclosing"),
    (4.5, "host\nkilled"),
    (5.5, "hang"),
    (7.5, "armed,\nclosing"),
    (9.0, "ceiling\ntrips"),
    (10.0, "reset in\na trip"),
)
_END_S, _PINGS = 11.5, ((3.0, 4.5), (7.5, 9.9))
_ARM: tuple[Command, ...] = (
    SetCeiling(counts=900),
    SetServoTravel(open_us=2310, closed_us=690),
    SetServo(target_us=1200, rate_us_per_s=1000),
    Start(),
)


def main() -> None:
    """Run the events once and draw the traces."""
    board = FirmwareBoard(bootloader=BOOTLOADER)
    actions = {
        1.5: board.reset,
        3.0: lambda: _send(board, *_ARM),
        5.5: board.hang,
        7.5: lambda: _send(board, *_ARM),
        9.0: lambda: board.set_pixels_mv(np.full((4, 2), 4800.0)),
        10.0: board.reset,
    }
    times_s = np.arange(0.0, _END_S, _STEP_S)
    safe, pulses = [], []
    for time_s in times_s:
        for due_s in [due_s for due_s in actions if due_s <= time_s + 1e-9]:
            actions.pop(due_s)()
        pinged = any(begin_s < time_s < end_s for begin_s, end_s in _PINGS)
        if pinged and round(time_s / _STEP_S) % 20 == 0:
            _send(board, Ping())
        board.run_until(time_s + _STEP_S)
        board.read_bytes()
        safe.append(board.safe_line)
        pulses.append(np.stack(board.read_pulses()))
    board.close()
    _draw(times_s, safe=np.array(safe), pulses=np.concatenate(pulses, axis=1))


def _send(board: FirmwareBoard, *commands: Command) -> None:
    for command in commands:
        board.write_bytes(encode_command(command, tag=1))


def _draw(times_s: np.ndarray, *, safe: np.ndarray, pulses: np.ndarray) -> None:
    mpl.rcParams["svg.hashsalt"] = "palpate"
    figure = Figure(figsize=(9, 4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(1, 2))
    upper.step(times_s, safe, where="post", color="#d64545")
    upper.set_yticks([0, 1], ["low", "high"])
    upper.set_ylabel("safe line")
    upper.set_ylim(-0.2, 1.2)
    lower.plot(pulses[0], pulses[1], ".", markersize=3, color="#1b7fbd")
    lower.set_ylabel("servo pulse, µs")
    lower.set_ylim(500, 2500)
    lower.set_xlabel("time since power-up, s (simulated)")
    for begin_s, text in EVENTS:
        for axes in (upper, lower):
            axes.axvline(begin_s, color="#7b8794", linewidth=0.7)
        upper.text(begin_s + 0.03, 1.25, text, fontsize=8, va="bottom")
    figure.savefig(OUT, metadata={"Date": None})


if __name__ == "__main__":
    main()
