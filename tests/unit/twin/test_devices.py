"""The simulated sensor, gripper and load cell, in simulated and in real time."""

from __future__ import annotations

import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.factories import draw

from palpate.arrays import FloatArray
from palpate.clock import ManualClock
from palpate.errors import DeviceTimeoutError
from palpate.gripper.interface import GripperCommand
from palpate.twin.devices import ServoCurrent, TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.paced_array import PacedArray
from palpate.twin.ranges import LAB
from palpate.twin.world import World


def make_world(name: str = "dragonskin-10", **options: object) -> World:
    return World(draw(name, 1), seed=1, **options)  # type: ignore[arg-type]


def test_twin_array_reads_at_fixed_rate_and_advances_clock() -> None:
    clock = ManualClock(start_s=100.0)
    array = TwinArray(make_world(clock=clock, frame_rate_hz=50.0))
    frames = [array.read(timeout_s=1.0) for _ in range(10)]
    np.testing.assert_allclose(np.diff([f.time_s for f in frames]), 0.02, atol=1e-9)
    assert [f.sequence for f in frames] == list(range(10))
    assert clock.now_s() == pytest.approx(100.2)
    assert frames[0].counts.shape == (4, 2)


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


def test_twin_array_read_before_next_scan_raises_timeout_error() -> None:
    setting = make_world(frame_rate_hz=2.0)
    array = TwinArray(setting)
    with pytest.raises(DeviceTimeoutError, match=r"scans every 0\.5 s"):
        array.read(timeout_s=0.1)
    assert setting.clock.now_s() == pytest.approx(0.1)
    array.close()
    array.close()
    assert setting.watchers == []


def test_twin_gripper_commands_are_clamped_and_move_at_rate_then_stop_then_open_fully() -> None:
    setting = make_world()
    gripper = TwinGripper(setting)
    sent = gripper.command(GripperCommand(target=-5.0, rate=1e6))
    assert (sent.target, sent.rate) == (gripper.limits.lowest, gripper.limits.fastest)
    gripper.command(GripperCommand(target=54.0, rate=10.0))
    for moving in (True, False):
        setting.clock.sleep_s(1.0)
        assert gripper.state().moving == moving
        assert gripper.state().width_mm == pytest.approx(64.0, abs=0.05)
        gripper.stop()
    gripper.release()
    setting.clock.sleep_s(1.0)
    assert gripper.state().width_mm == gripper.limits.highest


def test_twin_soft_gripper_reports_pressure_only() -> None:
    setting = make_world("avocado-day-3", gripper="soft")
    gripper = TwinGripper(setting)
    assert gripper.limits.drive == "pressure"
    gripper.command(GripperCommand(target=40.0, rate=20.0))
    setting.clock.sleep_s(5.0)
    state = gripper.state()
    assert state.pressure_kpa == pytest.approx(40.0, abs=0.5)
    assert np.isnan(state.width_mm)
    gripper.release()
    setting.clock.sleep_s(5.0)
    assert gripper.state().pressure_kpa == pytest.approx(0.0, abs=0.5)
    gripper.close()


def test_twin_load_cell_reads_in_one_gram_steps() -> None:
    setting = make_world("rigid-block")
    cell, gripper = TwinLoadCell(setting), TwinGripper(setting)
    assert abs(cell.read_n()) < 0.03
    gripper.command(GripperCommand(target=38.5, rate=20.0))
    setting.clock.sleep_s(4.0)
    readings = np.array([cell.read_n() for _ in range(200)])
    assert np.mean(readings) == pytest.approx(setting.force_n(4.0), abs=0.01)
    np.testing.assert_allclose(readings / 0.0098, np.round(readings / 0.0098), atol=1e-9)


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


def test_paced_array_speed_change_is_immediate(array: TwinArray) -> None:
    paced = PacedArray(array, speed=0.1)
    paced.read(timeout_s=1.0)
    paced.speed = 1000.0
    began_s = time.monotonic()
    for _ in range(50):
        paced.read(timeout_s=1.0)
    assert time.monotonic() - began_s < 5.0


#: No temperature effect; 40 mA of friction, independent of the load.
PLAIN = replace(
    LAB,
    servo_friction_ma=(40.0, 40.0),
    servo_friction_fraction=(0.0, 0.0),
    servo_friction_ripple=(0.0, 0.0),
    servo_friction_movement_sd=(0.0, 0.0),
    servo_warm_fraction=(0.0, 0.0),
)


@pytest.fixture
def current() -> ServoCurrent:
    return ServoCurrent(PLAIN, servo_seed=0, session_seed=1, start_s=0.0)


def sweep_ma(current: ServoCurrent, widths_mm: FloatArray) -> FloatArray:
    return np.array(
        [current.read_ma(0.0, force_n=0.0, width_mm=width, moving=True) for width in widths_mm]
    )


def test_servo_current_friction_sign_follows_direction(current: ServoCurrent) -> None:
    closing, opening = np.arange(60.0, 20.0, -0.1), np.arange(20.0, 60.0, 0.1)
    assert sweep_ma(current, closing)[1:].mean() == pytest.approx(40.0, abs=1.0)
    assert sweep_ma(current, opening)[1:].mean() == pytest.approx(-40.0, abs=1.0)


def test_servo_current_at_rest_is_constant_within_friction_band(current: ServoCurrent) -> None:
    held = []
    for number in range(80):
        width_mm = 60.0 - 0.1 * number
        reads = [
            current.read_ma(0.0, force_n=0.0, width_mm=width_mm, moving=False) for _ in range(12)
        ]
        held.append(np.mean(reads[1:] if number else reads))
    assert min(held[1:]) < -30.0
    assert max(held[1:]) > 30.0
    assert np.std(held[1:]) == pytest.approx(40.0 / np.sqrt(3), rel=0.2)
