"""The force ceiling on the board: armed by every rig, effective without the host."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest

from palpate.errors import DeviceError
from palpate.grasp.estimator import Observation
from palpate.grasp.pixel_ceiling import ceiling_counts
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperCommand
from palpate.gripper.pneumatic import PneumaticGripper
from palpate.rig import Rig
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import BoardStatus, Contents
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import GripperKind, World

pytestmark = pytest.mark.usefixtures("firmware_built")


@dataclass(kw_only=True)
class Desk:
    """A rig on a simulated board, with access to the board."""

    world: World
    board: FirmwareBoard
    rig: Rig

    @property
    def array(self) -> SerialArray:
        assert isinstance(self.rig.array, SerialArray)
        return self.rig.array

    def wait(self, duration_s: float) -> None:
        """Read frames on the host for a duration."""
        until_s = self.world.clock.now_s() + duration_s
        while self.world.clock.now_s() < until_s:
            self.array.read(timeout_s=1.0)

    def hang_host(self, duration_s: float) -> None:
        """Advance the time while the host does nothing."""
        for _ in range(round(duration_s / 0.01)):
            self.world.clock.sleep_s(0.01)
            self.world.drive_value(self.world.clock.now_s())


def desk_of(kind: GripperKind) -> Iterator[Desk]:
    obj = draw_object(np.random.default_rng(3), "apple")
    world = World(obj, seed=2, sheet_seed=2, level="lab", gripper=kind, frame_rate_hz=50.0)
    board = FirmwareBoard(seed=1)
    soft = kind == "soft"
    array = SerialArray(
        FirmwareStream(world, board=board),
        clock=world.clock,
        layout=world.layout,
        rate_hz=50.0,
        oversampling=world.oversampling,
        contents=Contents.PRESSURE if soft else Contents.PIXELS,
    )
    gripper = PneumaticGripper(array, clock=world.clock) if soft else TwinGripper(world)
    calibration = calibrate_twin(seed=2, level="lab", apart_from="strawberry", kind=kind)
    rig = Rig(name="desk", array=array, gripper=gripper, clock=world.clock, calibration=calibration)
    yield Desk(world=world, board=board, rig=rig)
    rig.close()


@pytest.fixture
def rigid() -> Iterator[Desk]:
    yield from desk_of("rigid")


@pytest.fixture
def soft() -> Iterator[Desk]:
    yield from desk_of("soft")


def crush(desk: Desk) -> None:
    """Close on the apple, far beyond the ceiling."""
    desk.rig.gripper.command(GripperCommand(target=5.0, rate=60.0))


def test_rig_arms_the_board_ceiling_which_acts_without_the_host(rigid: Desk) -> None:
    """The host hangs while the fingers close, so only the board measures the force."""
    rigid.wait(0.3)
    crush(rigid)
    assert rigid.board.safe_line
    while rigid.world.force_n(rigid.world.clock.now_s()) < 15.0:
        rigid.hang_host(0.01)
    assert rigid.board.safe_line, "the board must not act below the ceiling"
    rigid.hang_host(1.0)
    assert not rigid.board.safe_line
    assert rigid.array.read(timeout_s=1.0).oversampling == rigid.world.oversampling


def test_grasp_below_the_ceiling_does_not_trip_the_board(rigid: Desk) -> None:
    plan = plan_grasp(rigid.rig.calibration, gripper=rigid.rig.gripper, target_force_n=8.0)
    result = run_grasp(plan, array=rigid.array, gripper=rigid.rig.gripper, clock=rigid.world.clock)
    assert result.outcome is Outcome.HELD, result.faults
    assert rigid.board.safe_line


def test_tripped_ceiling_opens_the_hand_and_ends_the_next_grasp_immediately(rigid: Desk) -> None:
    """The ceiling is set below the held force, so that the board trips."""
    gripper, clock = rigid.rig.gripper, rigid.world.clock
    plan = plan_grasp(rigid.rig.calibration, gripper=gripper, target_force_n=3.0)

    def lower_ceiling(observation: Observation) -> None:
        if rigid.world.force_n(clock.now_s()) > 1.0 and rigid.board.safe_line:
            rigid.array.arm_ceiling(
                int(observation.frame.counts.max()) // observation.frame.oversampling - 1
            )

    result = run_grasp(
        plan, array=rigid.array, gripper=gripper, clock=clock, subscribers=[lower_ceiling]
    )
    assert result.outcome is Outcome.FORCE_LIMIT
    assert "the board's own ceiling has tripped" in result.faults[0]
    assert len(result.faults) == 1
    assert gripper.state().width_mm > 73.0
    again = run_grasp(plan, array=rigid.array, gripper=gripper, clock=clock)
    assert again.outcome is Outcome.FORCE_LIMIT
    assert again.frames < 5
    assert not rigid.board.safe_line


def test_reset_board_is_armed_again(rigid: Desk) -> None:
    rigid.wait(0.3)
    rigid.board.reset()
    rigid.wait(3.0)
    crush(rigid)
    rigid.hang_host(2.0)
    assert not rigid.board.safe_line


def test_tripped_ceiling_persists_after_a_reset(rigid: Desk) -> None:
    rigid.wait(0.3)
    crush(rigid)
    rigid.wait(1.5)
    assert rigid.array.read(timeout_s=1.0).ceiling_tripped
    rigid.rig.gripper.release()
    rigid.board.reset()
    rigid.wait(3.0)
    assert rigid.array.read(timeout_s=1.0).ceiling_tripped
    newest = rigid.array.read_newest()
    assert newest.status & BoardStatus.CEILING_TRIPPED, "the board must store the trip"
    assert not rigid.board.safe_line
    rigid.array.arm_ceiling(900)
    rigid.wait(0.1)
    assert not rigid.array.read(timeout_s=1.0).ceiling_tripped
    assert rigid.board.safe_line


def test_board_ceiling_vents_soft_fingers_without_the_host(soft: Desk) -> None:
    """The twin's soft fingers stay below the ceiling, so a lower one is set."""
    soft.wait(0.3)
    soft.array.arm_ceiling(ceiling_counts(soft.rig.calibration, force_n=2.0))
    soft.rig.gripper.command(GripperCommand(target=20.0, rate=60.0))
    soft.world.drive(50.0, rate=200.0)
    soft.hang_host(0.4)
    assert not soft.board.safe_line, "the heartbeat would have vented after 0.5 s"
    assert soft.board.output_kpa == 0.0
    soft.wait(0.2)
    with pytest.raises(DeviceError, match="a pixel reached its ceiling"):
        soft.rig.gripper.command(GripperCommand(target=10.0, rate=60.0))
    soft.rig.gripper.release()
    soft.rig.gripper.state()
