"""Calibration steps of both drives, current included, measured on the twin as a user would."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.calibrate.guided import Bench, measure_block, measure_force, measure_rest
from palpate.calibrate.servo_current import measure_current, measure_gears
from palpate.errors import CalibrationError, DeviceError, DeviceTimeoutError
from palpate.estimate.servo_force import CurrentLaw
from palpate.grasp.planning import plan_grasp
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import BlockPairs, Calibration
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


def bench_of(world: World, array: TwinArray | None = None) -> Bench:
    soft = world.gripper == "soft"
    return Bench(
        array=array or TwinArray(world),
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
    bench = bench_of(world)
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
    assert plan.compliance is None
    # A third of a newton per kPa on the block, and a margin for other openings.
    assert 1 / 3 < plan.steepest_n < 0.5


@pytest.fixture(scope="module")
def rigid() -> Calibration:
    return calibrate_twin(seed=4, level="lab", apart_from="")


@pytest.mark.slow
def test_current_while_closing_is_a_line_in_force(rigid: Calibration) -> None:
    assert rigid.current is not None
    law = CurrentLaw.fit(rigid.current)
    # 14 mA/N of grip and 5 to 25 % friction on top; gears take 20 to 60 mA (twin's ranges).
    assert 13.0 < law.ma_per_n < 18.5
    assert 15.0 < law.gears.mean_ma < 65.0
    assert 0.0 < law.gears.movement_ma < 0.3 * law.gears.mean_ma
    assert 5.0 < law.noise_ma < 8.0
    assert min(rigid.current.force_n) < 0.1 < 12.0 < max(rigid.current.force_n)


def test_empty_hand_shows_its_gears_over_the_whole_way_and_one_that_is_not_empty_is_refused() -> (
    None
):
    world = World(None, seed=6)
    found = measure_gears(bench_of(world), sweeps=1)
    assert min(found.width_mm) < 10.0 < 70.0 < max(found.width_mm)
    assert len(set(found.movement)) > 30
    world.place(draw_object(np.random.default_rng(1), "dragonskin-10"))
    with pytest.raises(CalibrationError, match="close empty"):
        measure_gears(bench_of(world), sweeps=1)
    assert measure_gears(bench_of(World(None, seed=6, gripper="soft")), sweeps=1) is None


def test_hand_is_open_afterwards_and_one_without_current_measures_none() -> None:
    for kind in ("rigid", "soft"):
        world = World(None, seed=6, gripper=kind)
        world.place(draw_object(np.random.default_rng(1), "rigid-block"))
        bench = bench_of(world)
        found = measure_current(bench, up_to_n=4.0, repeats=1)
        assert (found is None) == (kind == "soft")
        assert bench.gripper.limits.closure(bench.gripper.state()) == pytest.approx(0.0, abs=0.5)


def test_plan_uses_a_calibrated_current(rigid: Calibration) -> None:
    gripper: Any = TwinGripper(World(None, seed=4))
    assert plan_grasp(rigid, gripper=gripper).current is not None
    assert plan_grasp(replace(rigid, current=None), gripper=gripper).current is None


@pytest.mark.slow
def test_two_blocks_calibrate_the_closing_of_soft_fingers() -> None:
    made = calibrate_twin(seed=7, level="field", apart_from="", kind="soft")
    assert made.current is None
    plan = plan_grasp(made, gripper=TwinGripper(World(None, seed=7, gripper="soft")))
    assert plan.compliance is None, "their pressure tells no size"
    assert plan.bend.mm_per_kpa == pytest.approx(1.4, rel=0.05)
    assert plan.bend.compliance.slope_mm_per_n == pytest.approx(3.7, rel=0.1)


def test_file_keeps_the_current_and_older_files_lack_it(rigid: Calibration) -> None:
    text = rigid.as_text()
    assert Calibration.from_text(text).current == rigid.current
    older = json.loads(text)
    del older["current"]
    assert Calibration.from_text(json.dumps(older)).current is None
    older["current"] = {"force_n": [1.0], "current_a": [0.05]}
    with pytest.raises(CalibrationError, match="current lacks current_ma and has current_a"):
        Calibration.from_text(json.dumps(older))
