"""The MuJoCo rigs: complete and early ended grasps, and a core without MuJoCo."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from tests.pages import test_commands_of_page_run

from palpate.calibration import Calibration
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import Subscriber, run_grasp
from palpate.grasp.safety import SafetyLimits
from palpate.rig import Rig, open_rig, rig_names
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import TwinObject, draw_object
from palpate_mujoco import MujocoWorld

__all__ = ["test_commands_of_page_run"]
pytestmark = pytest.mark.slow

SEED = 3


@pytest.fixture(scope="module")
def rig() -> Rig:
    return open_rig("mujoco", object_name="strawberry", seed=SEED)


@pytest.fixture
def page(rig: Rig) -> str:
    """Return the page that opens the rig of this file, already calibrated."""
    assert (rig.name, rig.subject) == ("mujoco", "strawberry")
    return "mujoco"


@pytest.fixture(scope="module")
def calibration(rig: Rig) -> Calibration:
    return rig.calibration


def draw_subject(name: str) -> TwinObject:
    return draw_object(np.random.default_rng([SEED, 10]), name)


def grasp(world: MujocoWorld, plan: Plan, *subscribers: Subscriber) -> GraspResult:
    array, gripper = TwinArray(world), TwinGripper(world)
    return run_grasp(plan, array=array, gripper=gripper, clock=world.clock, subscribers=subscribers)


def planned(calibration: Calibration, world: MujocoWorld, target_force_n: float) -> Plan:
    return plan_grasp(calibration, gripper=TwinGripper(world), target_force_n=target_force_n)


def test_strawberry_is_held_and_measured(rig: Rig) -> None:
    # Four standard deviations of the size error (`benchmarks/mujoco_rig.py`).
    check_held(rig, size_mm=0.8)


def test_swinging_jaw_holds_and_measures_strawberry() -> None:
    # On a strawberry the pads are not parallel, which increases the size error.
    check_held(open_rig("mujoco-so101", object_name="strawberry", seed=SEED), size_mm=2.0)


def check_held(rig: Rig, *, size_mm: float) -> None:
    """Grasp on a rig, and compare with its truth."""
    plan = plan_grasp(rig.calibration, gripper=rig.gripper)
    result = run_grasp(plan, array=rig.array, gripper=rig.gripper, clock=rig.clock)
    assert rig.truth is not None
    truth = rig.truth()
    assert result.outcome is Outcome.HELD
    assert rig.is_simulated
    assert truth["size_mm"] == draw_subject("strawberry").size_mm
    assert result.size_mm.value == pytest.approx(truth["size_mm"], abs=size_mm)
    assert result.force_n.low < truth["force_n"] < result.force_n.high
    assert not truth["damaged"]


def test_empty_hand_ends_with_nothing_there(calibration: Calibration) -> None:
    world = MujocoWorld(None, seed=SEED)
    assert grasp(world, planned(calibration, world, 5.0)).outcome is Outcome.NOTHING_THERE


def test_grasp_reaches_target_and_opens(calibration: Calibration) -> None:
    world = MujocoWorld(draw_subject("springs-8"), seed=SEED)
    result = grasp(world, planned(calibration, world, 8.0))
    assert result.outcome is Outcome.HELD
    assert world.truth().force_n == pytest.approx(8.0, rel=0.25)
    assert world.drive_value(world.now_s()) == pytest.approx(74.0, abs=0.1)


def test_force_ceiling_ends_grasp_and_opens(calibration: Calibration) -> None:
    world = MujocoWorld(draw_subject("springs-8"), seed=SEED)
    safe = replace(planned(calibration, world, 3.0), safety=SafetyLimits(force_ceiling_n=5.0))

    def push_finger(_: Observation) -> None:
        if world.sensor.finger_n.mean() > 2.0:
            world.data.body("right_finger").xfrc_applied[0] = -40.0

    result = grasp(world, safe, push_finger)
    assert result.outcome is Outcome.FORCE_LIMIT
    assert world.drive_value(world.now_s()) == pytest.approx(74.0, abs=0.1)
    assert world.force_n(world.now_s()) == 0.0


def test_core_lists_rigs_without_importing_mujoco() -> None:
    assert {"mujoco", "mujoco-so101"} <= set(rig_names())
    code = (
        "import sys, palpate, palpate.cli, palpate.rig; palpate.rig.rig_names(); "
        "print({'mujoco', 'gymnasium', 'palpate_mujoco'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
