"""Cost of reading a board live: share of a core, losses and delay at 500 frames/s.

Run `python benchmarks/serial_reading.py`. The board is a second process at the far end of a
pseudo-terminal; its wire is as fast as the kernel, so the delay is the host's share alone.
"""

from __future__ import annotations

import argparse
import os
import time
import tty
from contextlib import suppress

import numpy as np

from palpate.clock import RealClock
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.byte_stream import SerialStream
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire import encode_message, unpack
from palpate.sensor.wire_messages import Ack, BoardIdentity, CommandType, FrameMessage, Result


def board(master: int, *, rate_hz: float) -> None:
    """Answer the set-up, then send frames on an even raster until the port closes."""
    pending, start_s, sent = b"", 0.0, 0
    os.set_blocking(master, False)
    while True:
        try:
            *packets, pending = (pending + os.read(master, 4096)).split(b"\0")
        except BlockingIOError:
            packets = []
        for packet in packets:
            kind, payload = unpack(packet) or (0, b"\0")
            if kind == CommandType.IDENTIFY:
                os.write(master, encode_message(identity(payload[0], rate_hz)))
            else:
                ack = Ack(command=kind, tag=payload[0], result=Result.OK)
                os.write(master, encode_message(ack))
            if kind in (CommandType.START, CommandType.STOP):
                start_s, sent = time.monotonic() * (kind == CommandType.START), 0
        if start_s and time.monotonic() >= start_s + sent / rate_hz:
            with suppress(BlockingIOError):  # nobody reads: lost, as on a real port
                time_us = round((start_s + sent / rate_hz) * 1e6)
                os.write(master, encode_message(frame(sent, time_us)))
            sent += 1
        time.sleep(2e-4)


def frame(sequence: int, time_us: int) -> FrameMessage:
    return FrameMessage(
        sequence=sequence,
        time_us=time_us,
        stream=1,
        oversampling=1,
        status=0,
        counts=np.full((4, 2), 300 + sequence % 10, dtype=np.uint16),
    )


def identity(tag: int, rate_hz: float) -> BoardIdentity:
    return BoardIdentity(
        tag=tag, protocol=1, version=(0, 0, 0), features=0, rows=4, cols=2, oversampling=1,
        max_rows=16, max_cols=16, max_oversampling=64, settle_us=0, heartbeat_ms=500,
        reset_cause=1, streaming=False, conversion_us=0, baud=1_000_000_000, rate_hz=rate_hz,
        highest_rate_hz=rate_hz, board="pty",
    )  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate-hz", type=float, default=500.0)
    parser.add_argument("--seconds", type=float, default=20.0)
    options = parser.parse_args()
    master, slave = os.openpty()
    tty.setraw(slave)
    if os.fork() == 0:
        os.close(slave)
        try:
            board(master, rate_hz=options.rate_hz)
        except OSError:
            os._exit(0)
    os.close(master)
    array = SerialArray(
        SerialStream(os.ttyname(slave)),
        clock=RealClock(),
        layout=RIGID_LAYOUT,
        rate_hz=options.rate_hz,
    )
    os.close(slave)
    cpu_s, start_s = time.process_time(), time.monotonic()
    delays_s = []
    while time.monotonic() - start_s < options.seconds:
        delays_s.append(-array.read(timeout_s=1.0).time_s + time.monotonic())
    cpu_s, wall_s = time.process_time() - cpu_s, time.monotonic() - start_s
    counters = array.counters
    array.close()
    print(
        f"{counters.frames} frames in {wall_s:.1f} s: {100 * cpu_s / wall_s:.1f} % of a core, "
        f"{counters.lost} lost, {counters.corrupt} corrupt, {counters.late} late; "
        f"delay median {np.median(delays_s) * 1e3:.2f} ms, p99 "
        f"{np.quantile(delays_s, 0.99) * 1e3:.2f} ms"
    )


if __name__ == "__main__":
    main()
