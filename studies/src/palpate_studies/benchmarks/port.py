"""A board read live over a port at 500 frames/s, compared with pyserial's readline of CSV."""

from __future__ import annotations

import time
from functools import partial

import numpy as np

from palpate.clock import RealClock
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.serial_array import SerialArray
from palpate_studies.benchmarks.protocol import Measured, Ratio
from palpate_studies.benchmarks.pty_board import board, lines_of_csv, on_a_port
from palpate_studies.benchmarks.running import command_of

RATE_HZ = 500.0
#: At most this share of a core.
SHARE_WANTED = 0.10


def measure(full: bool) -> Measured:
    """Read both for the same time, one after the other."""
    seconds = 20.0 if full else 5.0
    ours_s, note = _by_palpate(seconds)
    theirs_s = _by_readline(seconds)
    return Measured(
        ratios=[
            Ratio(
                what="reading a port",
                size=round(seconds * RATE_HZ),
                of="frames of 8 pixels",
                peer=peer,
                ours=ours_s,
                theirs=taken_s,
                wanted=wanted,
            )
            for peer, taken_s, wanted in (
                ("pyserial readline of CSV", theirs_s, None),
                ("one core", seconds, 1 / SHARE_WANTED),
            )
        ],
        notes=(f"Simulated boards on pseudo-terminals at {RATE_HZ:g} frames/s. {note}",),
    )


command = command_of("port")


def _by_palpate(seconds: float) -> tuple[float, str]:
    """Return the processor time, and what was lost and late."""
    delays_s = []
    with on_a_port(partial(board, rate_hz=RATE_HZ)) as (port, _):
        array = SerialArray(
            SerialStream(port), clock=RealClock(), layout=RIGID_LAYOUT, rate_hz=RATE_HZ
        )
        cpu_s, start_s = time.process_time(), time.monotonic()
        while time.monotonic() - start_s < seconds:
            delays_s.append(-array.read(timeout_s=1.0).time_s + time.monotonic())
        cpu_s = time.process_time() - cpu_s
        counters = array.counters
        array.close()
    median_ms, late_ms = 1e3 * np.quantile(delays_s, [0.5, 0.99])
    return cpu_s, (
        f"Of {counters.frames} frames {counters.lost} lost, {counters.corrupt} corrupt; delay "
        f"in the host {median_ms:.2f} ms (p99 {late_ms:.2f})."
    )


def _by_readline(seconds: float) -> float:
    import serial

    with (
        on_a_port(partial(lines_of_csv, rate_hz=RATE_HZ)) as (name, _),
        serial.Serial(name, timeout=1.0) as port,
    ):
        cpu_s, start_s = time.process_time(), time.monotonic()
        while time.monotonic() - start_s < seconds:
            np.array(port.readline().split(b","), dtype=int).reshape(4, 2)
        return time.process_time() - cpu_s
