"""The simulated sensor, gripper and load cell, in simulated and in real time."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from tests.factories import draw

from palpate.gripper.interface import GripperCommand
from palpate.rig.paced_array import PacedArray
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import World


def make_world(name: str = "dragonskin-10", **options: object) -> World:
    return World(draw(name, 1), seed=1, **options)  # type: ignore[arg-type]


def test_twin_array_queues_unread_frames_in_order() -> None:
    setting = make_world(frame_rate_hz=10.0)
    array, gripper = TwinArray(setting), TwinGripper(setting)
    setting.clock.sleep_s(1.0)
    gripper.command(GripperCommand(target=30.0, rate=50.0))
    setting.clock.sleep_s(1.0)
    gripper.state()
    frames = [array.read(timeout_s=1.0) for _ in range(20)]
    assert [f.sequence for f in frames] == list(range(20))
    assert setting.clock.now_s() == pytest.approx(2.0)
    # Frames scanned before the command are not affected by it.
    assert np.ptp([f.counts.mean() for f in frames[:9]]) < 5
    assert frames[-1].counts.mean() > frames[0].counts.mean() + 20


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
    paced = PacedArray(array, speed=1e-4)
    paced.read(timeout_s=1.0)
    timer = threading.Timer(0.05, paced.skip_wait)
    timer.start()
    began_s = time.monotonic()
    paced.read(timeout_s=1.0)  # due in 200 s
    assert time.monotonic() - began_s < 100.0
    timer.join()
