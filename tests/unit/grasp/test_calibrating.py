"""Calibration steps: both drives, and a sensor that fails while the hand presses."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.errors import CalibrationError, DeviceError, DeviceTimeoutError
from palpate.grasp.calibrating import Bench, measure_block, measure_force, measure_rest
from palpate.grasp.planning import plan_grasp
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import BlockPairs
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import World


class Failing(TwinArray):
    """Falls silent once the hand presses."""

    def read(self, *, timeout_s: float) -> Any:
        if self.world.force_n(self.world.clock.now_s()) > 0.5:
            raise DeviceTimeoutError("no frame in 2.00 s; check the cable")
        return super().read(timeout_s=timeout_s)

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.world = world


def bench_of(world: World, array: TwinArray) -> Bench:
    soft = world.gripper == "soft"
    return Bench(
        array=array,
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=15.0 if soft else 51.0,
    )


@pytest.mark.parametrize("kind", ["rigid", "soft"])
def test_sensor_that_fails_leaves_the_hand_open(kind: Any) -> None:
    world = World(None, seed=3, gripper=kind)
    bench = bench_of(world, Failing(world))
    measure_rest(bench)
    obj = draw_object(np.random.default_rng(1), "springs-8")
    with pytest.raises(DeviceTimeoutError, match="check the cable") as raised:
        measure_force(bench, holds_n=((2.0,),), reseat=lambda _: world.place(obj), dwell_s=0.4)
    assert raised.value.exit_status == 3
    state = bench.gripper.state()
    assert bench.gripper.limits.closure(state) == pytest.approx(0.0, abs=0.5)
    assert world.force_n(world.clock.now_s()) == 0.0


@pytest.mark.parametrize(
    ("readings", "words"),
    [((0, 0), "no signal from r0c0"), ((100, 600), "does not come to rest in 120 s")],
)
def test_sensor_that_can_not_rest_is_broken_equipment(
    readings: tuple[int, int], words: str
) -> None:
    class Broken(TwinArray):
        """Its first pixel is cut off, or has a loose contact."""

        def read(self, *, timeout_s: float) -> Any:
            frame = super().read(timeout_s=timeout_s)
            counts = frame.counts.copy()
            counts[0, 0] = readings[frame.sequence % 30 // 15]
            return replace(frame, counts=counts)

    world = World(None, seed=3)
    with pytest.raises(DeviceError, match=words) as raised:
        measure_rest(bench_of(world, Broken(world)))
    assert raised.value.exit_status == 3


@pytest.mark.parametrize("kind", ["rigid", "soft"])
def test_block_pairs_are_of_the_drive(kind: Any) -> None:
    world = World(None, seed=3, gripper=kind)
    bench = bench_of(world, TwinArray(world))
    world.place(draw_object(np.random.default_rng(1), "rigid-block"))
    block = measure_block(bench, block_mm=40.0, up_to_n=4.0, repeats=1, dwell_s=0.1)
    used, unused = block.width_mm, block.pressure_kpa
    if kind == "soft":
        used, unused = unused, used
    assert np.ptp(used) > 0.5
    assert unused == ()
    assert len(used) == len(block.force_n) > 4
    assert np.all(np.diff(block.force_n) > 0)


@pytest.mark.slow
def test_a_calibration_fits_its_own_kind_of_hand() -> None:
    rigid = calibrate_twin(seed=3, level="lab", apart_from="apple")
    with pytest.raises(CalibrationError, match="driven by pressure: its calibration needs 4"):
        plan_grasp(rigid, gripper=TwinGripper(World(None, seed=3, gripper="soft")))
    block = BlockPairs(
        block_mm=(40.0,) * 4,
        width_mm=(),
        force_n=(0.0, 1.0, 2.0, 3.0),
        pressure_kpa=(24.0, 27.0, 30.0, 33.0),
    )
    soft = replace(rigid, block=block)
    with pytest.raises(CalibrationError, match="this gripper is driven by width"):
        plan_grasp(soft, gripper=TwinGripper(World(None, seed=3)))
    plan = plan_grasp(soft, gripper=TwinGripper(World(None, seed=3, gripper="soft")))
    assert plan.give is None
    # A third of a newton per kPa on the block, and a margin for other openings.
    assert 1 / 3 < plan.steepest_n < 0.5
