"""Simulated frames in real time."""

from __future__ import annotations

import threading
import time

import pytest

from palpate.twin.devices import TwinArray
from palpate.twin.paced_array import PacedArray
from palpate.twin.world import World


@pytest.fixture
def array() -> TwinArray:
    return TwinArray(World(None, seed=1, frame_rate_hz=50.0))


def test_paced_array_returns_frames_in_real_time(array: TwinArray) -> None:
    paced = PacedArray(array, speed=5.0)
    began_s = time.monotonic()
    frames = [paced.read(timeout_s=1.0) for _ in range(26)]
    took_s = time.monotonic() - began_s
    assert [frame.sequence for frame in frames] == list(range(26))
    # 25 periods of 20 ms, five times as fast: never sooner, whatever the machine does.
    assert took_s >= 0.1


def test_paced_array_skip_wait_returns_frame_at_once(array: TwinArray) -> None:
    paced = PacedArray(array, speed=0.025)
    paced.read(timeout_s=1.0)
    timer = threading.Timer(0.05, paced.skip_wait)
    timer.start()
    began_s = time.monotonic()
    paced.read(timeout_s=1.0)  # due in 0.8 s
    assert time.monotonic() - began_s < 0.7
    timer.join()


def test_paced_array_speed_change_is_immediate(array: TwinArray) -> None:
    paced = PacedArray(array, speed=0.1)
    paced.read(timeout_s=1.0)
    paced.speed = 1000.0
    began_s = time.monotonic()
    for _ in range(50):
        paced.read(timeout_s=1.0)
    assert time.monotonic() - began_s < 5.0
