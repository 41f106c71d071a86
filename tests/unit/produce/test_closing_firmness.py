"""Firmness of a round body from the whole of a closing, and where the hand stood."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.estimate.compliance import Compliance
from palpate.estimate.gain import Gain
from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperState
from palpate.produce.grasp_record import hold_measurements
from palpate.produce.ripeness.closing import (
    ClosingWatch,
    closing_firmness,
    round_softness,
    sheet_gain,
)
from palpate.rig.simulated import calibrate_twin
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World

pytestmark = pytest.mark.slow

GIVE = Compliance(
    slope_mm_per_n=0.2, pad_mm=(0.0,) * 5, zero_mm=0.3, residual_mm=0.02, largest_force_n=15.0
)
FORCES = np.array([1.0, 2.5, 4.0, 5.0])


def closing(
    softness: float, *, give: Compliance = GIVE
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Return the widths of a closing on a fruit that has relaxed by a tenth at its last force."""
    elastic = FORCES * np.exp([0.0, 0.0, 0.0, 0.1])
    return np.asarray(62.0 - softness * elastic ** (2 / 3) - give.give_mm(FORCES))


@pytest.mark.parametrize("softness", [0.15, 0.4, 1.2])
def test_a_round_body_is_found_whatever_its_softness(softness: float) -> None:
    found, sd = round_softness(closing(softness), force_n=FORCES, floor_n=0.05, give=GIVE)
    assert found == pytest.approx(softness, rel=1e-6)
    assert 0.0 < sd < softness


def test_interval_follows_the_scatter_of_the_steps() -> None:
    rng = np.random.default_rng(2)
    width = closing(0.4)
    found, said = [], []
    for _ in range(300):
        read = FORCES * np.exp(0.05 * rng.standard_normal(4))
        one, sd = round_softness(width, force_n=read, floor_n=0.01, give=GIVE)
        found.append(one)
        said.append(sd)
    # The settled force is believed a little more, and how far fruit relaxes is open besides.
    assert np.mean(found) == pytest.approx(0.4, rel=0.05)
    assert 0.6 < np.std(found) / np.mean(said) < 1.2


@pytest.fixture(scope="module")
def watched() -> tuple[ClosingWatch, GraspResult, list[Observation], list[GraspState]]:
    calibration = calibrate_twin(seed=5, level="lab", apart_from="ball-44lbs")
    world = World(
        draw_object(np.random.default_rng(5), "ball-44lbs"), seed=5, sheet_seed=5, level="lab"
    )
    gripper = TwinGripper(world)
    plan = plan_grasp(calibration, gripper=gripper, target_force_n=5.0, hold_s=0.0)
    seen, beliefs, watch = list[Observation](), list[GraspState](), ClosingWatch(plan)
    result = run_grasp(
        plan,
        array=TwinArray(world),
        gripper=gripper,
        clock=world.clock,
        subscribers=[seen.append],
        watchers=[watch.see, beliefs.append],
    )
    assert watch.list_measurements()["firmness_n_per_mm"] == closing_firmness(
        next(one for one in reversed(beliefs) if one.phase == "hold"), plan=plan
    )
    return watch, result, seen, beliefs


def test_watched_grasp_has_firmness_and_width(
    watched: tuple[ClosingWatch, GraspResult, list[Observation], list[GraspState]],
) -> None:
    watch, result, seen, _ = watched
    firmness = watch.list_measurements()["firmness_n_per_mm"]
    assert firmness.low < result.stiffness_n_per_mm.value < firmness.high
    width = hold_measurements(seen, result=result, drive="width")["width_mm"]
    assert 40.0 < width.low <= width.value <= width.high < 49.0


def test_grasp_without_answer_has_neither_firmness_nor_width(
    watched: tuple[ClosingWatch, GraspResult, list[Observation], list[GraspState]],
) -> None:
    watch, result, seen, beliefs = watched
    lost = replace(result, moments=())
    assert hold_measurements(seen, result=lost, drive="width") == {}
    assert hold_measurements((), result=result, drive="width") == {}
    blind = [replace(one, gripper=GripperState(time_s=0.0, pressure_kpa=5.0)) for one in seen]
    assert hold_measurements(blind, result=result, drive="width") == {}
    nothing = ClosingWatch(watch.plan)
    nothing.see(beliefs[0])
    assert nothing.list_measurements() == {}
    assert closing_firmness(beliefs[0], plan=watch.plan) is None


def test_loads_fainter_than_a_newton_do_not_count(
    watched: tuple[ClosingWatch, GraspResult, list[Observation], list[GraspState]],
) -> None:
    watch, _, _, beliefs = watched
    held = next(one for one in reversed(beliefs) if one.phase == "hold")
    gain = float(np.exp(held.estimate.gain.log_mean))
    steps = held.estimate.steps
    law = watch.plan.early_law
    readings = np.linspace(0.0, max(step.touch.reading for step in steps), 500)
    load_n = gain * law.force_n(readings).value
    load_n = load_n - load_n[0]
    before = min(steps, key=lambda step: step.touch.reading)

    def told(added_n: float) -> float:
        """Return the firmness where a step at a wrong width is put before the true ones."""
        reading = float(np.interp(added_n, load_n, readings)) + before.touch.reading
        extra = replace(
            before,
            closure=before.closure + 0.1,
            touch=replace(before.touch, reading=reading),
        )
        others = (before, extra, *steps[steps.index(before) + 1 :])
        other = replace(held, estimate=replace(held.estimate, steps=others))
        found = closing_firmness(other, plan=watch.plan)
        return found.value

    true = closing_firmness(held, plan=watch.plan)
    assert told(0.8) == pytest.approx(true.value)
    assert abs(told(1.6) / true.value - 1.0) > 0.01


def test_gain_of_the_contact_is_stored(
    watched: tuple[ClosingWatch, GraspResult, list[Observation], list[GraspState]],
) -> None:
    watch, _, _, beliefs = watched
    held = next(one for one in reversed(beliefs) if one.phase == "hold")
    kept = watch.list_measurements()["sheet_gain"]
    assert kept.value == pytest.approx(np.exp(held.estimate.gain.log_mean))
    assert kept.value != 1.0
    assert kept.high / kept.value == pytest.approx(kept.value / kept.low)
    unknown = Gain.from_calibration(law_sd=held.estimate.gain.law_sd)
    alone = replace(held, estimate=replace(held.estimate, gain=unknown))
    assert sheet_gain(alone, plan=watch.plan).value == 1.0
