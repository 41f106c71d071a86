"""A few grasps of the fault campaign, one per earlier defect."""

from __future__ import annotations

import pytest

from palpate.grasp.safety import FORCE_CEILING_N
from palpate.twin.world import GripperKind
from palpate_studies.fault_grasps import (
    KINDS,
    Cell,
    run_faulty_grasp,
)
from palpate_studies.faults import is_unexplained

pytestmark = pytest.mark.slow

#: Fault, phase, object, hand.
CASES = {
    "a ground wire off": ("all pixels short", "approach", "rigid-block", "rigid"),
    "beside the sheet": ("object beside the sheet", "start", "strawberry", "rigid"),
    "frozen frames": ("frames constant", "approach", "ball-44lbs", "soft"),
    "all pixels alike": ("all pixels 512", "squeeze", "strawberry", "rigid"),
    "runs on": ("gripper runs on", "squeeze", "rigid-block", "rigid"),
}


@pytest.mark.parametrize("name", CASES)
def test_fault_ends_grasp_safely_with_reason(name: str) -> None:
    fault, phase, thing, kind = CASES[name]
    assert kind in KINDS
    found = run_faulty_grasp(
        Cell(fault=fault, phase=phase, thing=thing, kind=kind, speed=1.0), seed=77
    )
    assert found.struck
    assert found.outcome in ("sensor_lost", "gripper_fault", "force_limit")
    assert found.reason
    assert not is_unexplained(found)
    assert found.peak_n < 1.2 * FORCE_CEILING_N
    assert not (thing == "strawberry" and found.damaged)


@pytest.mark.parametrize(("speed", "seed"), [(1.0, 920_913), (2.0, 920_914)])
def test_inverted_readings_end_grasp_without_damage(speed: float, seed: int) -> None:
    """The reading falls as the force rises; forces once reached 7.2 and 5.6 N."""
    found = run_faulty_grasp(
        Cell(fault="inverted", phase="squeeze", thing="strawberry", kind="rigid", speed=speed),
        seed=seed,
    )
    assert found.outcome == "sensor_lost"
    assert "or the sheet does not show the force" in found.reason
    assert not found.damaged
    assert found.peak_n < 5.0


@pytest.mark.parametrize("rate_hz", [15.0, 250.0])
@pytest.mark.parametrize("fault", ["object beside the sheet", "finger at rest", "half the reading"])
@pytest.mark.parametrize("kind", KINDS)
def test_sheet_that_fails_in_the_middle_of_a_movement_ends_grasp_near_the_target(
    kind: GripperKind, fault: str, rate_hz: float
) -> None:
    """At twice the speed, where one finger at rest once let soft fingers press with 8.7 N."""
    cell = Cell(
        fault=fault, phase="closing", thing="ball-44lbs", kind=kind, speed=2.0, rate_hz=rate_hz
    )
    found = run_faulty_grasp(cell, seed=77)
    assert found.struck
    assert found.outcome in ("sensor_lost", "slipped")
    # The target is 4 N.
    assert found.peak_n <= 8.0


def test_gripper_whose_moving_flag_flickers_ends_no_grasp_with_an_error() -> None:
    cell = Cell(
        fault="moving flag flickers",
        phase="approach",
        thing="ball-44lbs",
        kind="rigid",
        speed=1.0,
        rate_hz=250.0,
    )
    found = run_faulty_grasp(cell, seed=77)
    assert "failed" not in found.reason
    assert not is_unexplained(found)
