"""Guided calibration steps with both drives, including the current, on the twin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.factories import draw

from palpate.calibrate.guided import Bench, measure_force, measure_rest
from palpate.calibrate.servo_current import measure_gear_friction
from palpate.calibration import BlockPairs, Calibration, ForcePairs
from palpate.errors import CalibrationError, DeviceError, DeviceTimeoutError, NoiseError
from palpate.grasp.planning import plan_grasp
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World

#: Changes a frame, given the present force; None leaves it as it is.
Fault = Callable[[Any, float], int | None]


class FaultyArray(TwinArray):
    """An array whose first pixel reads something else at times, or that becomes silent."""

    def __init__(self, world: World, fault: Fault) -> None:
        super().__init__(world)
        self.world, self.fault = world, fault

    def read(self, *, timeout_s: float) -> Any:
        frame = super().read(timeout_s=timeout_s)
        wrong = self.fault(frame, self.world.force_n(self.world.clock.now_s()))
        counts = frame.counts.copy()
        counts[0, 0] = counts[0, 0] if wrong is None else wrong
        return replace(frame, counts=counts)


def silent_under_load(frame: Any, force_n: float) -> None:
    if force_n > 0.5:
        raise DeviceTimeoutError("no frame in 2.00 s; check the cable")


def open_bench(world: World, fault: Fault = lambda frame, force_n: None) -> Bench:
    return Bench(
        array=FaultyArray(world, fault),
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=15.0 if world.gripper == "soft" else 51.0,
    )


def is_open(bench: Bench) -> bool:
    return abs(bench.gripper.limits.closure(bench.gripper.state())) <= 0.5


def hold_springs(bench: Bench, world: World, **how: Any) -> ForcePairs:
    springs = draw("springs-8", 1)
    return measure_force(
        bench, holds_n=((2.0,),), reseat=lambda _: world.place(springs), dwell_s=0.4, **how
    )


@pytest.mark.parametrize("kind", ["rigid", "soft"])
def test_measure_force_failing_sensor_leaves_gripper_open(kind: Any) -> None:
    world = World(None, seed=3, gripper=kind)
    bench = open_bench(world, silent_under_load)
    measure_rest(bench)
    with pytest.raises(DeviceTimeoutError, match="check the cable") as raised:
        hold_springs(bench, world)
    assert raised.value.exit_status == 3
    assert is_open(bench)
    assert world.force_n(world.clock.now_s()) == 0.0


@pytest.mark.parametrize(
    ("readings", "words"),
    [((0, 0), "no signal from R0 C0"), ((100, 600), "does not come to rest in 120 s")],
    ids=["disconnected", "loose contact"],
)
def test_measure_rest_faulty_sensor_is_device_error(readings: tuple[int, int], words: str) -> None:
    bench = open_bench(
        World(None, seed=3), lambda frame, force_n: readings[frame.sequence % 30 // 15]
    )
    with pytest.raises(DeviceError, match=words) as raised:
        measure_rest(bench)
    assert raised.value.exit_status == 3


def test_measure_rest_does_not_wait_for_noise_to_end() -> None:
    rng, world = np.random.default_rng(1), World(None, seed=3)
    # Noise of one pixel in eight, which reads tens of percent in the mean.
    bench = open_bench(world, lambda frame, force_n: int(rng.integers(5, 500)))
    with pytest.raises(NoiseError, match="average more conversions"):
        measure_rest(bench)
    assert world.clock.now_s() < 60.0


@pytest.mark.parametrize("every", [1, 2])
def test_measure_force_pixel_open_under_load_is_no_weaker_reading(every: int) -> None:
    """The first pixel loses contact under load, in one of `every` frames."""

    def loose(frame: Any, force_n: float) -> int | None:
        return 0 if force_n > 0.5 and frame.sequence % every == 0 else None

    def measure(*fault: Fault) -> ForcePairs:
        world = World(None, seed=3)
        return hold_springs(open_bench(world, *fault), world, horizon_s=2.0)

    if every == 1:
        with pytest.raises(DeviceError, match=r"no signal from R0 C0 at .* N"):
            measure(loose)
        return
    assert measure(loose).excess[-1] == pytest.approx(measure().excess[-1], rel=0.01)


def twin_gripper(seed: int, kind: Any = "rigid") -> TwinGripper:
    return TwinGripper(World(None, seed=seed, gripper=kind))


@pytest.mark.slow
def test_calibration_is_refused_for_other_gripper_kind(rigid: Calibration) -> None:
    needs = r"pressure-driven: its calibration needs readings .* \(4 or more, .* and 0 of pressure"
    with pytest.raises(CalibrationError, match=needs):
        plan_grasp(rigid, gripper=twin_gripper(3, "soft"))
    block = BlockPairs(
        block_mm=(40.0,) * 4,
        width_mm=(),
        force_n=(0.0, 1.0, 2.0, 3.0),
        pressure_kpa=(24.0, 27.0, 30.0, 33.0),
    )
    soft = replace(rigid, block=block)
    with pytest.raises(CalibrationError, match="this gripper is width-driven"):
        plan_grasp(soft, gripper=twin_gripper(3))
    plan = plan_grasp(soft, gripper=twin_gripper(3, "soft"))
    assert plan.compliance is None
    # A third of a newton per kPa on the block, and a margin for other openings.
    assert 1 / 3 < plan.steepest_n < 0.5


@pytest.fixture(scope="module")
def rigid() -> Calibration:
    return calibrate_twin(seed=4, level="lab", apart_from="")


def test_measure_gear_friction_covers_travel_and_refuses_object() -> None:
    world = World(None, seed=6)
    found = measure_gear_friction(open_bench(world), sweeps=1)
    assert min(found.width_mm) < 10.0 < 70.0 < max(found.width_mm)
    assert len(set(found.movement)) > 30
    world.place(draw("dragonskin-10", 1))
    with pytest.raises(CalibrationError, match="close empty"):
        measure_gear_friction(open_bench(world), sweeps=1)
    assert measure_gear_friction(open_bench(World(None, seed=6, gripper="soft")), sweeps=1) is None
