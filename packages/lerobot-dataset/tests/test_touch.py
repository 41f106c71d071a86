"""The touch on another program's robot: its observations, and the jaw that is held and released."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from examples.own_gripper import MySensor, Plates, my_calibration
from tests.so101 import run_so101

import palpate
from palpate.calibration import ForcePairs
from palpate.clock import RealClock
from palpate.errors import CalibrationError, DeviceError, InputError
from palpate.gripper import sts_series as sts
from palpate.gripper.no_gripper import NoGripper
from palpate.gripper.packets import PROTOCOL_1
from palpate.gripper.servo_line import ServoLine
from palpate.rig import Rig
from palpate_lerobot.jaw_motion import JawMotion
from palpate_lerobot.touch import TOUCH_NAMES, Touch

pytestmark = pytest.mark.slow
LIMIT_N, OPEN_MM, TIMEOUT_S = 3.0, 74.0, 20.0


class Rack:
    """A jaw around a spring of 40 mm and 2 N/mm."""

    mm_per_unit = 1.0

    def __init__(self) -> None:
        self.plates = Plates(RealClock(), size_mm=40.0, n_per_mm=2.0)

    def read(self) -> float:
        return self.plates.width_mm

    def write(self, position: float) -> None:
        self.plates.move(position, rate=100.0)


class Sensor(MySensor):
    """The toy sensor, which can be unplugged."""

    is_unplugged = False

    def read(self, *, timeout_s: float) -> Any:
        if self.is_unplugged:
            raise DeviceError("the sensor is gone; check its cable")
        return super().read(timeout_s=timeout_s)


@pytest.fixture
def rack() -> Rack:
    return Rack()


@pytest.fixture
def rig(rack: Rack) -> Iterator[Rig]:
    sensor = Sensor(rack.plates, period_s=0.004)
    opened = palpate.open_rig(array=sensor, gripper=NoGripper(), calibration=my_calibration())
    yield opened
    opened.close()


@pytest.fixture
def touch(rig: Rig, rack: Rack) -> Iterator[Touch]:
    touch = Touch(rig, jaw=rack, limit_n=LIMIT_N)
    touch.start()
    touch.observe()
    yield touch
    touch.close()


def squeeze(touch: Touch, rack: Rack, *, start_mm: float = 41.0) -> None:
    """Close as a leader arm does until the jaw is held."""
    wanted, end_s = start_mm, time.monotonic() + TIMEOUT_S
    while not touch.reason:
        assert time.monotonic() < end_s
        wanted -= 0.05
        with touch.lock:
            rack.write(touch.limit(wanted))
        time.sleep(0.02)


def test_jaw_is_held_until_it_opens_and_may_then_close_again(touch: Touch, rack: Rack) -> None:
    rack.write(41.0)
    time.sleep(0.5)
    for _ in range(2):
        squeeze(touch, rack)
        assert "the limit of 3 N" in touch.reason
        # The leader stays closed.
        for wanted in (20.0, 5.0):
            with touch.lock:
                rack.write(touch.limit(wanted))
            time.sleep(0.1)
            assert 0.5 < rack.plates.force_n < 1.1 * LIMIT_N
        seen = touch.observe()
        assert tuple(seen) == TOUCH_NAMES
        assert seen["force_low_n"] < rack.plates.force_n < seen["force_high_n"]
        assert seen["force_low_n"] < seen["force_n"] < seen["force_high_n"]
        assert seen["change_percent"] < -10.0
        # It opens as asked, and only then may close again.
        end_s = time.monotonic() + TIMEOUT_S
        while touch.reason:
            assert time.monotonic() < end_s
            with touch.lock:
                assert touch.limit(OPEN_MM) == OPEN_MM
                rack.write(OPEN_MM)
            time.sleep(0.05)
        with touch.lock:
            assert touch.limit(41.0) == 41.0


@pytest.mark.parametrize("mm_per_s", [10.0, 30.0, 1000.0])
def test_fast_leader_does_not_press_beyond_the_limit(
    touch: Touch, rack: Rack, mm_per_s: float
) -> None:
    rack.write(43.0)
    time.sleep(0.5)
    wanted, largest_n, end_s = 43.0, 0.0, time.monotonic() + TIMEOUT_S
    while not touch.reason:
        assert time.monotonic() < end_s
        wanted -= mm_per_s / 30.0
        with touch.lock:
            rack.write(touch.limit(wanted))
        for _ in range(8):
            time.sleep(1 / 240)
            largest_n = max(largest_n, rack.plates.force_n)
    assert 0.5 < largest_n < 1.05 * LIMIT_N


def test_jaw_is_not_slowed_above_the_largest_object(rig: Rig, rack: Rack) -> None:
    touch = Touch(rig, jaw=rack, limit_n=LIMIT_N, free_above=45.0)
    touch.start()
    touch.observe()
    assert touch.limit(60.0) == 60.0
    assert touch.limit(5.0) == 45.0
    rack.write(45.0)
    time.sleep(0.5)
    # From here its position at the newest reading counts.
    touch.limit(5.0)
    time.sleep(0.2)
    assert 44.0 < touch.limit(5.0) < 45.0
    touch.close()


def test_jaw_that_presses_too_hard_opens_without_a_command(touch: Touch, rack: Rack) -> None:
    squeeze(touch, rack)
    rack.plates.size_mm += 2.0  # the object is turned to a larger diameter
    assert rack.plates.force_n > 1.3 * LIMIT_N
    end_s = time.monotonic() + TIMEOUT_S
    while rack.plates.force_n > 1.05 * LIMIT_N:
        assert time.monotonic() < end_s
        time.sleep(0.01)
    time.sleep(1.0)
    assert 0.6 * LIMIT_N < rack.plates.force_n < 1.05 * LIMIT_N


class ReversedRack(Rack):
    """The jaw of an arm that was calibrated with open and closed exchanged."""

    def read(self) -> float:
        return OPEN_MM - super().read()

    def write(self, position: float) -> None:
        super().write(OPEN_MM - position)


def test_jaw_that_closes_as_its_position_increases_is_stopped(rig: Rig, rack: Rack) -> None:
    rack.write(42.0)
    time.sleep(0.5)
    jaw = ReversedRack()
    jaw.plates = rack.plates
    touch = Touch(rig, jaw=jaw, limit_n=LIMIT_N)
    touch.start()
    touch.observe()
    wanted, largest_n, end_s = jaw.read(), 0.0, time.monotonic() + TIMEOUT_S
    while time.monotonic() < end_s and "calibrate it the other way" not in touch.reason:
        wanted += 0.2
        with touch.lock:
            jaw.write(touch.limit(wanted))
        time.sleep(1 / 30)
        largest_n = max(largest_n, rack.plates.force_n)
    for wanted in (OPEN_MM, 60.0, 5.0):
        with touch.lock:
            jaw.write(touch.limit(wanted))
        time.sleep(0.1)
        largest_n = max(largest_n, rack.plates.force_n)
    with pytest.raises(DeviceError, match="closes towards 100 %"):
        touch.observe()
    touch.close()
    assert 0.3 * LIMIT_N < largest_n < LIMIT_N


def test_error_of_a_held_jaw_names_the_lost_sensor(touch: Touch, rig: Rig, rack: Rack) -> None:
    squeeze(touch, rack)
    rig.array.is_unplugged = True  # type: ignore[attr-defined]
    time.sleep(0.5)
    with pytest.raises(DeviceError, match="check its cable"):
        touch.observe()


def test_opened_jaw_has_no_contact_although_the_sheet_recovers_later() -> None:
    motion = JawMotion(limit_n=3.0, n_per_unit=5.0, mm_per_unit=1.0)
    # It closes, holds at 38 mm and opens; the force falls to 1 N.
    for now_s, position, low_n in (
        (0.0, 41.0, 0.0),
        (0.1, 40.0, 0.0),
        (0.2, 39.0, 0.5),
        (0.3, 38.0, 2.0),
        (0.4, 39.0, 1.5),
    ):
        motion.move(position, now_s=now_s)
        motion.feel(low_n, low_n + 0.3, at_s=now_s)
        assert not motion.is_free
    motion.move(60.0, now_s=0.5)
    motion.feel(1.0, 1.3, at_s=0.5)
    assert motion.is_free
    # Closing again can meet a larger object.
    motion.move(58.0, now_s=0.6)
    assert not motion.is_free


def test_action_that_waited_for_the_bus_does_not_undo_the_stop(touch: Touch, rack: Rack) -> None:
    with touch.lock:  # the guard trips, and waits for the bus
        rack.write(38.0)
        end_s = time.monotonic() + TIMEOUT_S
        while not touch.reason:
            assert time.monotonic() < end_s
            time.sleep(0.01)
        assert touch.limit(5.0) >= 38.0


def test_jaw_of_a_lost_sensor_is_held_and_nothing_is_observed(
    touch: Touch, rig: Rig, rack: Rack
) -> None:
    rack.write(41.0)
    time.sleep(0.5)
    rig.array.is_unplugged = True  # type: ignore[attr-defined]
    end_s = time.monotonic() + TIMEOUT_S
    while not touch.reason:
        assert time.monotonic() < end_s
        time.sleep(0.01)
    time.sleep(0.5)
    with pytest.raises(DeviceError, match="check its cable"):
        touch.observe()
    with touch.lock:
        assert touch.limit(5.0) == pytest.approx(rack.read())
        # It may open, but without readings not close again.
        assert touch.limit(OPEN_MM) == OPEN_MM
        assert touch.limit(5.0) == pytest.approx(41.0)


def test_touch_without_a_guard_only_observes(rig: Rig, rack: Rack) -> None:
    touch = Touch(rig, jaw=rack)
    touch.start()
    rack.write(37.0)
    time.sleep(0.5)
    seen = touch.observe()
    assert 1.0 < seen["force_low_n"] < rack.plates.force_n < seen["force_high_n"]
    assert touch.limit(5.0) == 5.0


def test_touch_needs_a_force_law_and_a_limit_in_newtons(rig: Rig, rack: Rack) -> None:
    for limit_n in (0.0, 200.0):  # 200: grams
        with pytest.raises(InputError, match=f"limit_n {limit_n:g}.*at most 15 N"):
            Touch(rig, jaw=rack, limit_n=limit_n)
    nothing = ForcePairs(run=(), since_move_s=(), excess=(), relative_percent=(), force_n=())
    without = replace(rig.calibration, force=nothing)
    with pytest.raises(CalibrationError, match="no force law"):
        Touch(replace(rig, calibration=without), jaw=rack)


class Servo:
    """Servo 6 of the demo, as another program drives it; positions are ticks."""

    mm_per_unit = 70.0 * sts.RAD_PER_TICK

    def __init__(self, line: ServoLine) -> None:
        self.line = line

    def read(self) -> float:
        return self.line.read(sts.PRESENT_POSITION)

    def write(self, position: float) -> None:
        self.line.write(sts.GOAL_POSITION, round(position))


def test_arm_of_the_demo_goes_on_while_its_jaw_is_held(tmp_path: Path) -> None:
    with run_so101(tmp_path) as folder:
        jaw, pan = (
            ServoLine(str(folder / name), servo_id=number, baud=1_000_000, packets=PROTOCOL_1)
            for name, number in (("hand", 6), ("arm", 1))
        )
        rig = palpate.open_rig(str(folder / "simulated.toml"), gripper=NoGripper())
        touch = Touch(rig, jaw=Servo(jaw), limit_n=2.5)
        for line in (jaw, pan):
            line.write(sts.TORQUE_ENABLE, 1)
        touch.start()
        wanted, turned, forces_n, held = jaw.read(sts.PRESENT_POSITION) - 350, 0, [], 0
        jaw.write(sts.GOAL_POSITION, wanted)
        time.sleep(1.0)
        while held < 40 and turned < 600:
            wanted, turned = wanted - 1, turned + 1  # 2 mm/s
            with touch.lock:
                allowed = round(touch.limit(wanted))
                jaw.write(sts.GOAL_POSITION, allowed)
                pan.write(sts.GOAL_POSITION, sts.TICKS // 2 + turned)
            forces_n.append(touch.observe()["force_n"])
            held += allowed > wanted + 5
            time.sleep(0.05)
        at = pan.read(sts.PRESENT_POSITION)
        touch.close()
        jaw.close()
        pan.close()
    assert held == 40
    assert 0.8 < max(forces_n) < 2.8
    assert at - sts.TICKS // 2 > turned - 10
