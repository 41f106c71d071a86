"""Current beside a load cell, and pressure on two blocks: measured on the twin as a user would."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.servo_force import CurrentLaw
from palpate.grasp.calibrating import Bench
from palpate.grasp.calibrating_current import measure_current, measure_gears
from palpate.grasp.planning import plan_grasp
from palpate.rig.simulated import calibrate_twin
from palpate.sensor.calibration import Calibration
from palpate.twin.devices import TwinArray, TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import World


def bench_of(world: World) -> Bench:
    return Bench(
        array=TwinArray(world),
        gripper=TwinGripper(world),
        cell=TwinLoadCell(world),
        clock=world.clock,
        start=51.0 if world.gripper == "rigid" else 15.0,
    )


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


def test_plan_listens_to_the_current_where_it_was_calibrated(rigid: Calibration) -> None:
    gripper: Any = TwinGripper(World(None, seed=4))
    assert plan_grasp(rigid, gripper=gripper).current is not None
    assert plan_grasp(replace(rigid, current=None), gripper=gripper).current is None


@pytest.mark.slow
def test_two_blocks_tell_how_soft_fingers_close() -> None:
    made = calibrate_twin(seed=7, level="field", apart_from="", kind="soft")
    assert made.current is None
    plan = plan_grasp(made, gripper=TwinGripper(World(None, seed=7, gripper="soft")))
    assert plan.give is None, "their pressure tells no size"
    assert plan.bend.mm_per_kpa == pytest.approx(1.4, rel=0.05)
    assert plan.bend.give.slope_mm_per_n == pytest.approx(3.7, rel=0.1)


def test_file_keeps_the_current_and_older_files_lack_it(rigid: Calibration) -> None:
    text = rigid.as_text()
    assert Calibration.from_text(text).current == rigid.current
    older = json.loads(text)
    del older["current"]
    assert Calibration.from_text(json.dumps(older)).current is None
    older["current"] = {"force_n": [1.0], "current_a": [0.05]}
    with pytest.raises(CalibrationError, match="current lacks current_ma and has current_a"):
        Calibration.from_text(json.dumps(older))
