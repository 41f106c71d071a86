"""Three weights and a rigid block take the place of a load cell, up to a grasp to a force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.factories import draw
from tests.fixtures import calibrate_once

from palpate.calibrate.dead_weights import measure_loads
from palpate.calibrate.force_law import add_force_law
from palpate.calibrate.guided import measure_block
from palpate.calibration import Calibration, ForcePairs
from palpate.errors import CalibrationError
from palpate.force.of_calibration import force_now
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import Outcome
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperCommand, open_fully
from palpate.object.compliance import Compliance
from palpate.rig.bench import make_sheet_bench
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import TwinObject
from palpate.twin.world import World

SHEET = 3


class NoisyArray(TwinArray):
    """An array whose pixels have 3 % white noise."""

    def __init__(self, world: World, *, seed: int) -> None:
        super().__init__(world)
        self.rng = np.random.default_rng(seed)

    def read(self, *, timeout_s: float) -> Frame:
        frame = super().read(timeout_s=timeout_s)
        full = float(self.layout.divider.full_scale)
        ratio = (full / frame.counts - 1.0) * self.rng.normal(1.0, 0.03, frame.counts.shape)
        return replace(frame, counts=np.floor(full / (ratio + 1.0)).astype(int))


def open_world(
    obj: TwinObject | None, *, seed: int, noise_seed: int | None = None
) -> tuple[World, TwinArray, TwinGripper]:
    world = World(obj, seed=seed, sheet_seed=SHEET, frame_rate_hz=15)
    array = TwinArray(world) if noise_seed is None else NoisyArray(world, seed=noise_seed)
    gripper = TwinGripper(world)
    open_fully(gripper, clock=world.clock)
    world.clock.sleep_s(3.0)
    return world, array, gripper


@pytest.fixture(scope="module")
def weighed() -> Calibration:
    """Calibrate with weights alone: a flat stamp is pressed to each load, placed anew each time."""
    stamp = draw("dragonskin-20", 1)
    world, array, gripper = open_world(stamp, seed=71)
    cell = TwinLoadCell(world)

    def place(load_n: float) -> None:
        open_fully(gripper, clock=world.clock)
        world.clock.sleep_s(20.0)
        width_mm = stamp.size_mm + 1.0
        while cell.read_n() < 0.98 * load_n:
            width_mm -= 0.02
            gripper.command(GripperCommand(target=width_mm, rate=20.0))
            world.clock.sleep_s(0.05)

    pairs = measure_loads(array, loads_n=[1.5, 4.0, 9.0], place=place, clock=world.clock).pairs
    known = calibrate_once(seed=SHEET, level="lab", apart_from="")
    return add_force_law(replace(known, force=pairs, current=None))


@pytest.mark.slow
def test_three_weights_and_a_block_suffice_for_a_grasp_to_a_force(weighed: Calibration) -> None:
    block = draw("rigid-block", 1)
    world, array, gripper = open_world(block, seed=72)
    bench = make_sheet_bench(
        array,
        gripper=gripper,
        clock=world.clock,
        calibration=weighed,
        block_mm=block.size_mm,
    )
    found = measure_block(bench, block_mm=block.size_mm, up_to_n=8.0, repeats=3, dwell_s=0.42)
    # The announced force holds, though the sheet is uncertain and the block rigid.
    assert 5.0 < world.truth().peak_force_n < 8.0
    own, cell = (
        Compliance.fit(one.force_n, width_mm=one.width_mm, block_mm=one.block_mm)
        for one in (found, calibrate_once(seed=SHEET, level="lab", apart_from="").block)
    )
    assert own.deflection_mm(4.0) == pytest.approx(cell.deflection_mm(4.0), rel=0.5)
    calibration = replace(weighed, block=found)
    for seed, name in ((81, "tomato"), (82, "strawberry")):
        world, array, gripper = open_world(draw(name, seed), seed=seed)
        plan = plan_grasp(calibration, gripper=gripper, target_force_n=3.0)
        result = run_grasp(plan, array=array, gripper=gripper, clock=world.clock)
        truth = world.truth()
        assert result.outcome is Outcome.HELD, result.faults
        assert result.force_n.low <= truth.force_n <= result.force_n.high
        assert result.size_mm.low <= truth.size_mm <= result.size_mm.high
        assert truth.peak_force_n < 6.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_noise_of_the_open_hand_is_no_touch_of_the_block(weighed: Calibration, seed: int) -> None:
    block = draw("rigid-block", 1)
    world, array, gripper = open_world(block, seed=72, noise_seed=seed)
    bench = make_sheet_bench(
        array,
        gripper=gripper,
        clock=world.clock,
        calibration=weighed,
        block_mm=block.size_mm,
    )
    said: list[str] = []
    found = measure_block(
        bench, block_mm=block.size_mm, up_to_n=8.0, repeats=2, dwell_s=0.42, tell=said.append
    )
    assert max(found.width_mm) < block.size_mm + 1.0
    assert max(found.force_n) > 4.0
    assert len(said) == 2


@pytest.mark.slow
def test_closing_on_nothing_names_the_missing_block(weighed: Calibration) -> None:
    world, array, gripper = open_world(None, seed=74, noise_seed=4)
    bench = make_sheet_bench(
        array, gripper=gripper, clock=world.clock, calibration=weighed, block_mm=30.0
    )
    with pytest.raises(CalibrationError, match="no force was measured"):
        measure_block(bench, block_mm=30.0, up_to_n=6.0, repeats=1, dwell_s=0.42)


@pytest.mark.slow
def test_closing_on_something_soft_is_not_a_compliance(weighed: Calibration) -> None:
    soft = draw("ecoflex-10", 1)
    world, array, gripper = open_world(soft, seed=73)
    bench = make_sheet_bench(
        array, gripper=gripper, clock=world.clock, calibration=weighed, block_mm=soft.size_mm
    )
    with pytest.raises(CalibrationError, match="is a rigid block between the pads"):
        measure_block(bench, block_mm=soft.size_mm, up_to_n=15.0, repeats=1, dwell_s=0.42)
    assert gripper.state().width_mm > 70.0


def test_weights_on_one_pad_tell_the_force_on_it_and_that_of_a_grip() -> None:
    loads = np.array([1.5, 4.0, 9.0])
    one_pad = np.zeros((3, 8))
    one_pad[:, :4] = 2.0 * loads[:, None]
    pairs = ForcePairs(
        run=(0, 1, 2),
        since_move_s=(20.0,) * 3,
        excess=tuple(one_pad.sum(axis=1).tolist()),
        relative_percent=(-60.0, -80.0, -90.0),
        force_n=tuple(loads.tolist()),
        pixel_excess=tuple(map(tuple, one_pad.tolist())),
    )
    known = calibrate_once(seed=SHEET, level="lab", apart_from="")
    follower = force_now(add_force_law(replace(known, layout=RIGID_LAYOUT, force=pairs)))
    follower.step(0.0, np.zeros((4, 2)))
    weight = np.zeros((4, 2))
    weight[:2] = 8.0
    lying = follower.step(30.0, weight)
    assert lying.value == pytest.approx(4.0, rel=0.15)
    follower.step(60.0, np.zeros((4, 2)))
    grip = follower.step(90.0, np.full((4, 2), 8.0))
    assert grip.value == pytest.approx(4.0, rel=0.15)
