"""Simulated time at the pace of the wall's clock."""

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


def test_frames_come_at_the_pace_of_the_wall(array: TwinArray) -> None:
    paced = PacedArray(array, speed=5.0)
    began_s = time.monotonic()
    frames = [paced.read(timeout_s=1.0) for _ in range(26)]
    took_s = time.monotonic() - began_s
    assert [frame.sequence for frame in frames] == list(range(26))
    # 25 periods of 20 ms, five times as fast: never sooner, whatever the machine does.
    assert took_s >= 0.1


def test_a_request_does_not_wait_for_the_wall(array: TwinArray) -> None:
    paced = PacedArray(array, speed=0.025)
    paced.read(timeout_s=1.0)
    hurrying = threading.Timer(0.05, paced.skip_wait)
    hurrying.start()
    began_s = time.monotonic()
    paced.read(timeout_s=1.0)  # due in 0.8 s
    assert time.monotonic() - began_s < 0.7
    hurrying.join()


def test_a_change_of_speed_takes_effect_at_once(array: TwinArray) -> None:
    paced = PacedArray(array, speed=0.1)
    paced.read(timeout_s=1.0)
    paced.speed = 1000.0
    began_s = time.monotonic()
    for _ in range(50):
        paced.read(timeout_s=1.0)
    assert time.monotonic() - began_s < 5.0
