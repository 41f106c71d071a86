"""Stored width of the gripper at the answer of a grasp."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.gripper.interface import GripperState
from palpate.produce.grasp_record import hold_measurements
from palpate.rig.simulated import calibrate_twin
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def completed() -> tuple[GraspResult, list[Observation]]:
    """Return the result and the observations of a completed grasp."""
    calibration = calibrate_twin(seed=5, level="lab", apart_from="ball-44lbs")
    world = World(
        draw_object(np.random.default_rng(5), "ball-44lbs"), seed=5, sheet_seed=5, level="lab"
    )
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration, gripper=gripper, target_force_n=5.0, hold_s=0.0)
    seen = list[Observation]()
    result = run_grasp(
        plan,
        array=TwinArray(world),
        gripper=gripper,
        clock=world.clock,
        subscribers=[seen.append],
    )
    return result, seen


def test_hold_measurements_completed_grasp_contains_width(
    completed: tuple[GraspResult, list[Observation]],
) -> None:
    result, seen = completed
    width = hold_measurements(seen, result=result, drive="width")["width_mm"]
    assert 40.0 < width.low <= width.value <= width.high < 49.0


def test_hold_measurements_without_answer_or_width_is_empty(
    completed: tuple[GraspResult, list[Observation]],
) -> None:
    result, seen = completed
    unanswered = replace(result, moments=())
    assert hold_measurements(seen, result=unanswered, drive="width") == {}
    assert hold_measurements((), result=result, drive="width") == {}
    state = GripperState(time_s=0.0, pressure_kpa=5.0)
    without_width = [replace(one, gripper=state) for one in seen]
    assert hold_measurements(without_width, result=result, drive="width") == {}
