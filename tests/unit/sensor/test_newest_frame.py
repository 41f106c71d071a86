"""The newest frame of an array: what a program that was busy continues with."""

from __future__ import annotations

import os
import threading
import time
import tty
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from palpate.clock import Clock, ManualClock, RealClock
from palpate.errors import DeviceTimeoutError
from palpate.sensor.array import ArrayLayout, Frame, read_newest, read_waiting
from palpate.sensor.text_lines import open_board

PAIR = ArrayLayout(name="1x2", rows=1, cols=2, finger_of_row=(0,))


class QueueingArray:
    """An array of a user: it queues frames and dates them with the rig's clock."""

    layout = PAIR

    def __init__(self, clock: Clock, *, period_s: float, heeds_timeout: bool = True) -> None:
        self._clock, self._period_s, self._heeds_timeout = clock, period_s, heeds_timeout
        self._start_s, self._read = clock.now_s(), 0

    def read(self, *, timeout_s: float) -> Frame:
        at_s = self._start_s + self._read * self._period_s
        wait_s = at_s - self._clock.now_s()
        if wait_s > timeout_s and self._heeds_timeout:
            self._clock.sleep_s(timeout_s)
            raise DeviceTimeoutError("no frame")
        self._clock.sleep_s(max(wait_s, 0.0))
        self._read += 1
        return Frame(time_s=at_s, sequence=self._read - 1, counts=np.zeros((1, 2), dtype=int))

    def close(self) -> None:
        """Do nothing."""


@pytest.mark.parametrize("heeds_timeout", [True, False])
@pytest.mark.parametrize(("period_s", "pause_s"), [(1 / 15, 0.4), (0.004, 0.05), (0.004, 2.0)])
def test_newest_frame_after_a_pause_is_at_most_a_period_old(
    period_s: float, pause_s: float, heeds_timeout: bool
) -> None:
    clock = ManualClock(3.0)
    array = QueueingArray(clock, period_s=period_s, heeds_timeout=heeds_timeout)
    array.read(timeout_s=1.0)
    clock.sleep_s(pause_s)
    frame = read_newest(array, clock=clock, timeout_s=1.0)
    assert clock.now_s() - frame.time_s < period_s + 1e-9
    assert frame.sequence == 1 + frame.skipped
    assert frame.skipped >= round(pause_s / period_s) - 1


def test_waiting_or_fresh_frames_are_all_returned_in_order() -> None:
    clock = ManualClock()
    array = QueueingArray(clock, period_s=0.01)
    clock.sleep_s(0.1)
    frames = read_waiting(array, clock=clock, timeout_s=1.0)
    assert [frame.sequence for frame in frames] == list(range(11))
    clock.sleep_s(0.04)
    taken = [read_newest(array, clock=clock, timeout_s=1.0, fresh_s=0.05) for _ in range(5)]
    assert [(frame.sequence, frame.skipped) for frame in taken] == [(n, 0) for n in range(11, 16)]


@contextmanager
def printing_board(*, rate_hz: float) -> Iterator[str]:
    """Yield the port of a board that prints the number of the line, and 300."""
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    ended = threading.Event()

    def send() -> None:
        start_s, sent = time.monotonic(), 0
        unsent = deque[bytes]()
        while not ended.wait(max(start_s + sent / rate_hz - time.monotonic(), 0.0)):
            unsent.append(f"{sent % 1000},300\n".encode())
            sent += 1
            try:
                while unsent:
                    os.write(master, unsent[0])
                    unsent.popleft()
            except BlockingIOError:
                unsent.clear()  # without a reader, the port is full and lines are lost

    sender = threading.Thread(target=send)
    sender.start()
    yield os.ttyname(slave)
    ended.set()
    sender.join()
    os.close(master)
    os.close(slave)


@pytest.mark.slow
def test_port_keeps_the_newest_frame_while_no_program_reads() -> None:
    clock = RealClock()
    with printing_board(rate_hz=250.0) as port:
        array = open_board(port=port, layout="1x2")
        array.read(timeout_s=1.0)
        time.sleep(1.0)
        frame = read_newest(array, clock=clock, timeout_s=1.0)
        age_s = clock.now_s() - frame.time_s
        lines = [array.read(timeout_s=1.0).counts[0, 0] for _ in range(100)]
        array.close()
    # Without the newest frame, it would be a second old.
    assert age_s < 0.5
    assert frame.skipped > 150
    assert (np.diff(lines) % 1000 == 1).all()
    assert array.counters.dropped == 0
