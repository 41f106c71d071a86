"""The hobby-servo driver with the firmware, after failures of the board or the host."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
from tests.contract.hands import TRAVEL, make_firmware_board, make_world, open_hobby_servo

from palpate.errors import DeviceError, DeviceTimeoutError, InputError
from palpate.gripper.hobby_servo import HobbyServoGripper, ServoTravel
from palpate.gripper.interface import GripperCommand
from palpate.sensor.serial_array import SerialArray
from palpate.twin.firmware import FirmwareBoard
from palpate.twin.world import World

pytestmark = pytest.mark.system


@dataclass
class Bench:
    """Open fingers at rest on a simulated board."""

    world: World
    board: FirmwareBoard
    array: SerialArray
    gripper: HobbyServoGripper

    def follow(self, duration_s: float) -> None:
        """Read frames and states, like the control loop."""
        until_s = self.world.now_s() + duration_s
        while self.world.now_s() < until_s:
            self.array.read(timeout_s=1.0)
            self.gripper.state()


@pytest.fixture
def bench() -> Iterator[Bench]:
    world, board = make_world("rigid"), make_firmware_board(seed=2)
    array, gripper = open_hobby_servo(world, board)
    bench = Bench(world=world, board=board, array=array, gripper=gripper)
    bench.follow(0.3)
    yield bench
    array.close()


def close_to(bench: Bench, width_mm: float, *, rate: float = 40.0) -> None:
    bench.gripper.command(GripperCommand(target=width_mm, rate=rate))


def test_hobby_servo_holds_the_fingers_if_the_host_is_silent(bench: Bench) -> None:
    close_to(bench, 20.0, rate=20.0)
    bench.world.clock.sleep_s(3.0)
    stopped_mm = bench.world.drive_value(bench.world.now_s())
    assert stopped_mm == pytest.approx(74.0 - 20.0 * 0.5, abs=1.0)
    bench.array.read(timeout_s=1.0)
    with pytest.raises(DeviceError, match="holds the fingers in place: it received"):
        bench.gripper.state()
    bench.gripper.stop()
    bench.follow(0.5)
    assert bench.gripper.state().width_mm == pytest.approx(stopped_mm, abs=0.3)


@pytest.mark.parametrize("width_mm", [74.0, 50.0])
def test_hobby_servo_at_rest_closes_after_a_pause_of_the_program(
    bench: Bench, width_mm: float
) -> None:
    """The program was busy for seconds, and the fingers had nothing to do."""
    close_to(bench, width_mm)
    bench.follow(2.0)
    bench.world.clock.sleep_s(3.0)
    bench.follow(0.5)
    assert bench.gripper.state().width_mm == pytest.approx(width_mm, abs=0.1)
    close_to(bench, 40.0)
    bench.follow(2.0)
    assert bench.world.drive_value(bench.world.now_s()) == pytest.approx(40.0, abs=0.3)


def test_hobby_servo_opens_at_the_ceiling_and_refuses_to_close(bench: Bench) -> None:
    bench.array.arm_ceiling(1)
    close_to(bench, 40.0)
    bench.follow(2.0)
    assert bench.world.drive_value(bench.world.now_s()) == pytest.approx(74.0, abs=0.3)
    assert not bench.board.safe_line
    state = bench.gripper.state()
    assert (state.width_mm, state.moving) == (74.0, False)
    with pytest.raises(DeviceError, match="a pixel reached its ceiling"):
        close_to(bench, 40.0)
    bench.gripper.release()


def test_hobby_servo_state_raises_after_a_board_reset(bench: Bench) -> None:
    close_to(bench, 40.0)
    bench.follow(1.5)
    bench.board.reset()
    with pytest.raises(DeviceError, match="it was reset"):
        bench.follow(3.0)
    bench.board.read_pulses()
    bench.world.clock.sleep_s(0.3)
    assert len(bench.board.read_pulses()[0]) == 0
    assert bench.world.drive_value(bench.world.now_s()) == pytest.approx(40.0, abs=0.3)


def test_hobby_servo_state_with_stale_frames_raises(bench: Bench) -> None:
    bench.board.hang()
    bench.world.clock.sleep_s(0.2)
    bench.array.read_newest()
    bench.world.clock.sleep_s(0.6)
    with pytest.raises(DeviceTimeoutError, match=r"pulse is 0\.\d+ s old"):
        bench.gripper.state()


def test_hobby_servo_new_driver_keeps_the_finger_position(bench: Bench) -> None:
    close_to(bench, 40.0)
    bench.follow(1.5)
    second = HobbyServoGripper(bench.array, clock=bench.world.clock, travel=TRAVEL)
    bench.gripper = second
    bench.follow(0.5)
    assert second.state().width_mm == pytest.approx(40.0, abs=0.05)
    assert bench.world.drive_value(bench.world.now_s()) == pytest.approx(40.0, abs=0.3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"open_us": 499}, "open_us 499: must be 500 to 2500"),
        ({"open_us": 700.5}, "open_us 700.5: must be a whole number from 500 to 2500"),
        ({"closed_us": 690}, "are equal"),
        ({"closed_mm": 74.0}, "closed_mm 74: must be at least 0 and below open_mm 74"),
        ({"open_mm": float("nan")}, "below open_mm nan"),
    ],
)
def test_servo_travel_out_of_range_is_refused(changes: dict[str, float], message: str) -> None:
    given = {"open_us": 690, "closed_us": 2310, "open_mm": 74.0, "closed_mm": 5.0} | changes
    with pytest.raises(InputError, match=message):
        ServoTravel(**given)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "travel", [TRAVEL, ServoTravel(open_us=2310, closed_us=690, open_mm=74.0, closed_mm=5.0)]
)
def test_servo_travel_is_linear_in_both_directions(travel: ServoTravel) -> None:
    widths_mm = np.linspace(5.0, 74.0, 200)
    pulses_us = [travel.pulse_us(width_mm) for width_mm in widths_mm]
    back_mm = [travel.width_mm(pulse_us) for pulse_us in pulses_us]
    assert np.allclose(back_mm, widths_mm, atol=travel.mm_per_us)
    assert {travel.pulse_us(74.0), travel.pulse_us(5.0)} == {travel.open_us, travel.closed_us}
