"""A simulated board in its own process, at the other end of a pseudo-terminal.

The port has the speed of a pipe.
"""

from __future__ import annotations

import os
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import numpy as np

from palpate.sensor.wire import unpack
from palpate.sensor.wire_messages import (
    Ack,
    BoardIdentity,
    FrameMessage,
    Identify,
    Result,
    Start,
    Stop,
)
from palpate_studies.board_bytes import encode_message


@contextmanager
def run_on_port(act: Callable[[int], None]) -> Iterator[tuple[str, int]]:
    """Run `act` on a port in a process; yield port and process."""
    master, slave = os.openpty()
    tty.setraw(slave)
    child = os.fork()
    if child == 0:
        os.close(slave)
        with suppress(OSError):
            act(master)
        os._exit(0)
    os.close(master)
    try:
        yield os.ttyname(slave), child
    finally:
        os.kill(child, 9)
        os.waitpid(child, 0)
        os.close(slave)


def run_board(master: int, *, rate_hz: float) -> None:
    """Answer the setup commands, then send frames at a constant rate until the port closes."""
    pending, start_s, sent = b"", 0.0, 0
    os.set_blocking(master, False)
    while True:
        try:
            *packets, pending = (pending + os.read(master, 4096)).split(b"\0")
        except BlockingIOError:
            packets = []
        for packet in packets:
            kind, payload = unpack(packet) or (0, b"\0")
            if kind == Identify.kind:
                os.write(master, encode_message(identity(payload[0], rate_hz)))
            else:
                ack = Ack(command=kind, tag=payload[0], result=Result.OK)
                os.write(master, encode_message(ack))
            if kind in (Start.kind, Stop.kind):
                start_s, sent = time.monotonic() * (kind == Start.kind), 0
        if start_s and time.monotonic() >= start_s + sent / rate_hz:
            with suppress(BlockingIOError):  # without a reader the frame is lost, as on a real port
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
