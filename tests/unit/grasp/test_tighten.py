"""A grip that tightens when the held object slips."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.factories import closing_steps, draw, touch

from palpate.errors import InputError
from palpate.grasp.config import TIGHTEN
from palpate.grasp.estimator import ContactEstimate, Touch
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import run_grasp
from palpate.grasp.safety import SafetyLimits
from palpate.grasp.state import GraspState
from palpate.grasp.tighten import measure_shift, tighten
from palpate.recording import RecordingReader
from palpate.rig import open_rig
from palpate.rig.job import GraspJob
from palpate.sensor.pressure_centre import PressureCentres
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.friction import N_PER_G
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World

RATE_HZ = 15.0


def hold(along_mm: list[float], *, sheet_n: float = 2.0) -> tuple[Touch, ...]:
    """Return a hold with these pressure centres along both fingers, at 15 frames/s."""
    return tuple(
        replace(
            touch(sheet_n, time_s=number / RATE_HZ),
            centres=PressureCentres((c_mm, 0.0, c_mm, 0.0), (0.005,) * 4),
        )
        for number, c_mm in enumerate(along_mm)
    )


def test_shift_of_a_slide_exceeds_the_limit_and_noise_does_not() -> None:
    noise = 0.02 * np.random.default_rng(4).standard_normal(30)
    quiet, slide = noise.copy(), noise.copy()
    slide[-1] += 1.0
    drift = noise + np.linspace(0.0, 0.3, 30)
    ratios = []
    for along in (quiet, drift, slide):
        shift = measure_shift(hold(along.tolist()), since_s=0.0)
        assert shift is not None
        ratios.append(shift.ratio)
    assert max(ratios[:2]) < 0.6
    assert ratios[2] > 2.0


def test_shift_needs_a_baseline_unless_the_noise_is_known() -> None:
    touches = hold([0.0] * 7 + [0.5])
    assert measure_shift(touches, since_s=0.0) is None
    known = measure_shift(touches, since_s=0.0, noise_mm=np.full(4, 0.05))
    assert known is not None
    assert known.ratio == pytest.approx(0.5 / (TIGHTEN.threshold_sd * 0.05))


def slipping(*, force_high_n: float, damage_low_n: float, n_per_mm: float) -> GraspState:
    """Return a grip of 2 N whose object slips in the last frame."""
    readings = [0.5, 1.0, 1.5, 2.0]
    steps = closing_steps(readings, step_mm=0.5 / n_per_mm)
    touches = hold([0.0] * 20 + [0.8])
    estimate = ContactEstimate(
        now_s=touches[-1].time_s,
        still_since_s=-1.0,
        contact_s=-2.0,
        closure=steps[-1].closure,
        steps=steps,
        touches=touches,
        strongest_n=2.0,
        force_n=2.0,
        force_high_n=force_high_n,
        damage_low_n=damage_low_n,
    )
    return GraspState(phase=Phase.HOLD, estimate=estimate)


@given(
    force_high_n=st.floats(2.0, 20.0),
    damage_low_n=st.floats(1.0, 30.0) | st.just(math.inf),
    n_per_mm=st.floats(0.5, 20.0),
    ceiling_n=st.floats(1.0, 15.0),
)
@settings(max_examples=60, deadline=None)
def test_tightening_never_exceeds_ceiling_or_damage_limit(
    plan: Plan, force_high_n: float, damage_low_n: float, n_per_mm: float, ceiling_n: float
) -> None:
    """Upper force + steepest rise x (step + overrun) stays below the smaller limit."""
    plan = replace(plan, tighten=3, safety=SafetyLimits(force_ceiling_n=ceiling_n))
    state = slipping(force_high_n=force_high_n, damage_low_n=damage_low_n, n_per_mm=n_per_mm)
    command = tighten(state, plan)
    if command is None:
        assert [moment.name for moment in state.result.moments] == ["slip_at_limit"]
        return
    estimate = state.estimate
    travel = plan.gripper.target(estimate.closure) - command.target
    added_n = plan.steepest_n * (travel + command.rate * plan.safety.latency_s)
    assert travel > 0
    assert estimate.force_high_n >= force_high_n
    assert estimate.force_high_n + added_n <= min(ceiling_n, damage_low_n) * (1 + 1e-9)


def test_tightening_stops_after_the_planned_number_and_never_by_default(plan: Plan) -> None:
    def tightens(times: int, count: int) -> bool:
        state = slipping(force_high_n=2.5, damage_low_n=math.inf, n_per_mm=2.0)
        state.tightening.count = count
        return tighten(state, replace(plan, tighten=times)) is not None

    assert tightens(2, 1)
    assert not tightens(2, 2)
    assert not tightens(0, 0)


def test_hand_does_not_close_on_an_object_that_has_left(plan: Plan) -> None:
    state = slipping(force_high_n=2.5, damage_low_n=math.inf, n_per_mm=2.0)
    last = state.estimate.touches[-1]
    state.estimate.touches = (*state.estimate.touches[:-1], replace(last, sheet_n=0.1))
    assert tighten(state, replace(plan, tighten=3)) is None


def load_on_twin(times: int) -> tuple[World, GraspResult]:
    """Hold an apple while a springy pull rises to 1.8 times the friction limit."""
    apple = draw("apple", 5)
    world = World(apple, seed=7, sheet_seed=1, frame_rate_hz=60.0)
    gripper, is_pulled = TwinGripper(world), False

    def watch(state: GraspState) -> None:
        nonlocal is_pulled
        if state.phase is Phase.HOLD and state.phase_time_s > 1.0 and not is_pulled:
            is_pulled = True
            limit_n = 2.0 * apple.friction * world.force_n(world.now_s())
            world.lift(
                more_n=1.8 * limit_n - apple.mass_g * N_PER_G, rise_s=1.5, n_per_mm=0.1 * limit_n
            )

    plan = plan_grasp(
        calibrate_twin(seed=1, level="lab", apart_from="apple"),
        gripper=gripper,
        target_force_n=3.0,
        tighten=times,
        hold_s=4.0,
    )
    result = run_grasp(
        plan, array=TwinArray(world), gripper=gripper, clock=world.clock, watchers=[watch]
    )
    return world, result


def test_tightening_keeps_an_object_that_would_drop() -> None:
    world, result = load_on_twin(0)
    assert world.has_dropped
    assert result.outcome == "slipped"
    world, result = load_on_twin(3)
    assert not world.has_dropped
    assert result.outcome == "held"
    assert "tightened" in [moment.name for moment in result.moments]
    truth, force = world.truth(), result.force_n
    assert not truth.damaged
    assert force is not None
    assert force.low <= truth.force_n <= force.high, "the force is that of the tightened grip"
    assert truth.force_n > 4.0


def test_number_of_tightenings_is_checked_and_recorded(tmp_path: Path) -> None:
    with open_rig("sim-rigid", object_name="tomato", seed=4) as rig:
        with pytest.raises(InputError, match="tighten 11"):
            GraspJob(rig, tighten=11)
        with GraspJob(rig, tighten=2, record=tmp_path / "run.mcap") as job:
            job.run()
    with RecordingReader(tmp_path / "run.mcap") as recording:
        assert recording.info.tighten == 2
