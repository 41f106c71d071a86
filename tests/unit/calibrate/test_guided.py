"""Guided calibration steps with both drives, including the current, on the twin."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.calibrate.guided import Bench, measure_block, measure_force, measure_rest
from palpate.calibrate.servo_current import measure_current, measure_gear_friction
from palpate.errors import CalibrationError, DeviceError, DeviceTimeoutError
from palpate.estimate.servo_force import CurrentLaw
from palpate.grasp.planning import plan_grasp
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import BlockPairs, Calibration, ForcePairs
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import World


class FailingArray(TwinArray):
    """An array that becomes silent once the gripper presses."""

    def read(self, *, timeout_s: float) -> Any:
        if self.world.force_n(self.world.clock.now_s()) > 0.5:
            raise DeviceTimeoutError("no frame in 2.00 s; check the cable")
        return super().read(timeout_s=timeout_s)

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self.world = world


def open_bench(world: World, array: TwinArray | None = None) -> Bench:
    soft = world.gripper == "soft"
    return Bench(
        array=array or TwinArray(world),
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=15.0 if soft else 51.0,
    )


@pytest.mark.parametrize("kind", ["rigid", "soft"])
def test_measure_force_failing_sensor_leaves_gripper_open(kind: Any) -> None:
    world = World(None, seed=3, gripper=kind)
    bench = open_bench(world, FailingArray(world))
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
    [((0, 0), "no signal from R0 C0"), ((100, 600), "does not come to rest in 120 s")],
)
def test_measure_rest_faulty_sensor_is_device_error(readings: tuple[int, int], words: str) -> None:
    class Broken(TwinArray):
        """An array whose first pixel is disconnected or has a loose contact."""

        def read(self, *, timeout_s: float) -> Any:
            frame = super().read(timeout_s=timeout_s)
            counts = frame.counts.copy()
            counts[0, 0] = readings[frame.sequence % 30 // 15]
            return replace(frame, counts=counts)

    world = World(None, seed=3)
    with pytest.raises(DeviceError, match=words) as raised:
        measure_rest(open_bench(world, Broken(world)))
    assert raised.value.exit_status == 3


@pytest.mark.parametrize("every", [1, 2])
def test_measure_force_pixel_open_under_load_is_no_weaker_reading(every: int) -> None:
    class Loose(TwinArray):
        """An array whose first pixel loses contact under load, in one of `every` frames."""

        def read(self, *, timeout_s: float) -> Any:
            frame = super().read(timeout_s=timeout_s)
            counts = frame.counts.copy()
            force_n = self.world.force_n(self.world.clock.now_s())
            if force_n > 0.5 and frame.sequence % every == 0:
                counts[0, 0] = 0
            return replace(frame, counts=counts)

        def __init__(self, world: World) -> None:
            super().__init__(world)
            self.world = world

    def measure(make: type[TwinArray]) -> ForcePairs:
        world = World(None, seed=3)
        obj = draw_object(np.random.default_rng(1), "springs-8")
        return measure_force(
            open_bench(world, make(world)),
            holds_n=((2.0,),),
            reseat=lambda _: world.place(obj),
            dwell_s=0.4,
            horizon_s=2.0,
        )

    if every == 1:
        with pytest.raises(DeviceError, match=r"no signal from R0 C0 at .* N"):
            measure(Loose)
        return
    sound, loose = measure(TwinArray), measure(Loose)
    assert loose.excess[-1] == pytest.approx(sound.excess[-1], rel=0.01)


@pytest.mark.parametrize("kind", ["rigid", "soft"])
def test_measure_block_pairs_contain_only_drive_quantity(kind: Any) -> None:
    world = World(None, seed=3, gripper=kind)
    bench = open_bench(world)
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
def test_calibration_is_refused_for_other_gripper_kind() -> None:
    rigid = calibrate_twin(seed=3, level="lab", apart_from="apple")
    needs = r"pressure-driven: its calibration needs readings .* \(4 or more, .* and 0 of pressure"
    with pytest.raises(CalibrationError, match=needs):
        plan_grasp(rigid, gripper=TwinGripper(World(None, seed=3, gripper="soft")))
    block = BlockPairs(
        block_mm=(40.0,) * 4,
        width_mm=(),
        force_n=(0.0, 1.0, 2.0, 3.0),
        pressure_kpa=(24.0, 27.0, 30.0, 33.0),
    )
    soft = replace(rigid, block=block)
    with pytest.raises(CalibrationError, match="this gripper is width-driven"):
        plan_grasp(soft, gripper=TwinGripper(World(None, seed=3)))
    plan = plan_grasp(soft, gripper=TwinGripper(World(None, seed=3, gripper="soft")))
    assert plan.compliance is None
    # A third of a newton per kPa on the block, and a margin for other openings.
    assert 1 / 3 < plan.steepest_n < 0.5


@pytest.fixture(scope="module")
def rigid() -> Calibration:
    return calibrate_twin(seed=4, level="lab", apart_from="")


@pytest.mark.slow
def test_current_law_of_closing_matches_twin_ranges(rigid: Calibration) -> None:
    assert rigid.current is not None
    law = CurrentLaw.fit(rigid.current)
    # 14 mA/N of grip and 5 to 25 % friction on top; gears take 20 to 60 mA (twin's ranges).
    assert 13.0 < law.ma_per_n < 18.5
    assert 15.0 < law.gears.mean_ma < 65.0
    assert 0.0 < law.gears.movement_ma < 0.3 * law.gears.mean_ma
    assert 5.0 < law.noise_ma < 8.0
    assert min(rigid.current.force_n) < 0.1 < 12.0 < max(rigid.current.force_n)


def test_measure_gear_friction_covers_travel_and_refuses_object() -> None:
    world = World(None, seed=6)
    found = measure_gear_friction(open_bench(world), sweeps=1)
    assert min(found.width_mm) < 10.0 < 70.0 < max(found.width_mm)
    assert len(set(found.movement)) > 30
    world.place(draw_object(np.random.default_rng(1), "dragonskin-10"))
    with pytest.raises(CalibrationError, match="close empty"):
        measure_gear_friction(open_bench(world), sweeps=1)
    assert measure_gear_friction(open_bench(World(None, seed=6, gripper="soft")), sweeps=1) is None


def test_measure_current_opens_gripper_and_returns_none_without_current() -> None:
    for kind in ("rigid", "soft"):
        world = World(None, seed=6, gripper=kind)
        world.place(draw_object(np.random.default_rng(1), "rigid-block"))
        bench = open_bench(world)
        found = measure_current(bench, up_to_n=4.0, repeats=1)
        assert (found is None) == (kind == "soft")
        assert bench.gripper.limits.closure(bench.gripper.state()) == pytest.approx(0.0, abs=0.5)


def test_plan_grasp_uses_calibrated_current(rigid: Calibration) -> None:
    gripper: Any = TwinGripper(World(None, seed=4))
    assert plan_grasp(rigid, gripper=gripper).current is not None
    assert plan_grasp(replace(rigid, current=None), gripper=gripper).current is None


@pytest.mark.slow
def test_calibrate_twin_two_blocks_calibrate_soft_fingers() -> None:
    made = calibrate_twin(seed=7, level="field", apart_from="", kind="soft")
    assert made.current is None
    plan = plan_grasp(made, gripper=TwinGripper(World(None, seed=7, gripper="soft")))
    assert plan.compliance is None, "the pressure contains no information on size"
    assert plan.bend.mm_per_kpa == pytest.approx(1.4, rel=0.05)
    assert plan.bend.compliance.slope_mm_per_n == pytest.approx(3.7, rel=0.1)


def test_calibration_file_stores_current_and_older_files_open_without(rigid: Calibration) -> None:
    text = rigid.as_text()
    assert Calibration.from_text(text).current == rigid.current
    older = json.loads(text)
    del older["current"]
    assert Calibration.from_text(json.dumps(older)).current is None
    older["current"] = {"force_n": [1.0], "current_a": [0.05]}
    with pytest.raises(
        CalibrationError, match="current lacks current_ma and has unknown keys: current_a"
    ):
        Calibration.from_text(json.dumps(older))
