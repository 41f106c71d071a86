"""The controller stays within its limits and ends the grasp, for any sensor readings."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.factories import fit_even_sheet

from palpate.force.servo_force import CurrentLaw, GearFriction
from palpate.grasp.controller import GraspController
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.safety import FORCE_CEILING_N, SafetyLimits, largest_step
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperCommand, GripperLimits, GripperState
from palpate.object.compliance import Compliance
from palpate.sensor.array import ArrayLayout, Frame

LIMITS = GripperLimits(drive="width", lowest=20.0, highest=40.0, fastest=60.0)
LAYOUT = ArrayLayout(name="two", rows=2, cols=1, finger_of_row=(0, 1))
FORCE = np.array([0.3, 0.6, 1.2, 2.5, 5.0, 10.0])
COMPLIANCE = Compliance.fit(FORCE, width_mm=40 - 0.2 * FORCE, block_mm=40.0)
PLAN = Plan(
    layout=LAYOUT,
    rest_ohm=np.full((2, 1), 9000.0),
    law=fit_even_sheet(LAYOUT.pixels, force_n=FORCE, scatter=0.1),
    compliance=COMPLIANCE,
    steepest_n=COMPLIANCE.stiffest_n_per_mm,
    gripper=LIMITS,
    longest_s=30.0,
)

plans = st.builds(
    lambda ceiling, target, step, slowest: replace(
        PLAN,
        gripper=replace(LIMITS, slowest=slowest),
        safety=SafetyLimits(force_ceiling_n=ceiling),
        target_force_n=target,
        step=step,
    ),
    st.floats(0.5, FORCE_CEILING_N),
    st.none() | st.floats(0.5, 15.0),
    st.floats(0.2, 5.0),
    st.sampled_from([0.0, 20.0]),
)


def assert_bounded(
    grasp_state: GraspState, command: GripperCommand, *, plan: Plan, width: float
) -> None:
    """Assert that a command keeps the force below ceiling and damage limit."""
    assert LIMITS.lowest <= command.target <= LIMITS.highest
    assert 0 < command.rate <= LIMITS.fastest
    closing = width - command.target
    if closing <= 0:
        return
    assert command.rate >= plan.gripper.slowest
    added_n = (closing + command.rate * plan.safety.latency_s) * plan.steepest_n
    limit_n = min(plan.safety.force_ceiling_n, grasp_state.estimate.damage_low_n)
    assert grasp_state.estimate.force_high_n + added_n <= limit_n * (1 + 1e-9)
    assert grasp_state.phase is not Phase.RELEASE


@pytest.mark.slow
@given(plan=plans, counts=st.lists(st.integers(0, 1023), min_size=1, max_size=40), data=st.data())
@settings(max_examples=60)
def test_controller_with_random_readings_and_plans_stays_safe(
    plan: Plan, counts: list[int], data: st.DataObject
) -> None:
    """With random readings, commands stay within limits and the grasp ends."""
    is_stuck = data.draw(st.booleans())
    controller, width, rest = GraspController(plan), LIMITS.highest, 350
    grasp_state = controller.state
    for index in range(int((plan.longest_s + 12.0) * 15)):
        reading = rest if index < 10 else counts[(index // 5) % len(counts)]
        frame = Frame(time_s=index / 15, sequence=index, counts=np.full((2, 1), reading))
        state = GripperState(time_s=index / 15, width_mm=width)
        command = controller.step(Observation(frame=frame, gripper=state))
        if grasp_state.has_ended:
            assert command is None
            break
        if command is None:
            continue
        assert_bounded(grasp_state, command, plan=plan, width=width)
        width = width if is_stuck else command.target
    assert grasp_state.has_ended


@dataclass
class Adversary:
    """Gripper with an object that swells, stiffens and changes its gain."""

    rng: np.random.Generator
    size_mm: float = 35.0
    n_per_mm: float = 2.0
    gain: float = 1.0
    width_mm: float = LIMITS.highest
    target_mm: float = LIMITS.highest
    rate: float = 1.0

    def observe(self, index: int, *, every_s: float) -> Observation:
        """Advance by one frame; change the object's properties at random."""
        travel_mm = np.clip(
            self.target_mm - self.width_mm, -self.rate * every_s, self.rate * every_s
        )
        self.width_mm += float(travel_mm)
        if self.rng.random() < 0.01:
            self.size_mm += float(self.rng.uniform(-0.5, 0.7))
            self.n_per_mm *= float(np.exp(self.rng.normal(0, 0.5)))
            self.gain *= float(np.exp(self.rng.normal(0, 0.3)))
        squeezed = max(self.size_mm - self.width_mm, 0.0)
        force_n = squeezed / (1 / self.n_per_mm + 0.2)
        ohm = 9000.0 / (1 + 2 * self.gain * force_n * np.exp(self.rng.normal(0, 0.02, (2, 1))))
        counts = np.round(1024 / (1 + ohm / LAYOUT.divider.reference_ohm)).astype(int)
        moving = self.width_mm != self.target_mm
        shown = round(self.width_mm / 0.05) * 0.05
        return Observation(
            frame=Frame(time_s=index * every_s, sequence=index, counts=counts),
            gripper=GripperState(
                time_s=index * every_s,
                width_mm=shown,
                current_ma=40 + 14 * force_n + float(self.rng.normal(0, 6)),
                moving=moving,
            ),
        )


CURRENT = CurrentLaw(
    gears=GearFriction(mean_ma=40.0, mean_sd_ma=1.0, movement_ma=3.0), ma_per_n=14.0, noise_ma=6.0
)


def run_adversarial_grasp(plan: Plan, *, seed: int, rate_hz: float) -> set[Activity | Phase]:
    """Grasp an adversarial object, check all commands, and return the activities."""
    world, controller = Adversary(np.random.default_rng(seed)), GraspController(plan)
    grasp_state, activities = controller.state, set[Activity | Phase]()
    for index in range(int((plan.longest_s + 15.0) * rate_hz)):
        observation = world.observe(index, every_s=1 / rate_hz)
        command = controller.step(observation)
        activities.add(grasp_state.activity)
        if grasp_state.has_ended:
            break
        if command is not None:
            assert_bounded(
                grasp_state,
                command,
                plan=plan,
                width=plan.gripper.target(grasp_state.estimate.closure),
            )
            world.target_mm, world.rate = command.target, command.rate
    assert grasp_state.has_ended
    return activities


@pytest.mark.slow
@given(
    plan=plans,
    seed=st.integers(0, 2**32 - 1),
    rate_hz=st.sampled_from([15.0, 60.0]),
    has_current=st.booleans(),
)
@settings(max_examples=40)
def test_commands_stay_within_bound_for_any_object(
    plan: Plan, seed: int, rate_hz: float, has_current: bool
) -> None:
    run_adversarial_grasp(
        replace(plan, current=CURRENT if has_current else None), seed=seed, rate_hz=rate_hz
    )


@pytest.mark.slow
def test_adversary_reaches_every_activity() -> None:
    firm = replace(PLAN, target_force_n=4.0, tries=2, current=CURRENT)
    every = {*Phase} - {Phase.APPROACH, Phase.SETTLE} | {*Activity} - {Activity.WAIT}
    seen, seed = set[Activity | Phase](), 0
    while seed < 24 and not seen >= every:
        seen |= run_adversarial_grasp(firm, seed=seed, rate_hz=15.0)
        seed += 1
    assert seen == every


@given(
    force=st.floats(0, 100),
    stiffness=st.floats(0.01, 100),
    ceiling=st.floats(0.1, FORCE_CEILING_N),
    damage=st.floats(0.1, 100) | st.just(float("inf")),
)
def test_largest_step_satisfies_invariant(
    force: float, stiffness: float, ceiling: float, damage: float
) -> None:
    limits = SafetyLimits(force_ceiling_n=ceiling)
    found = largest_step(
        force_high_n=force, steepest_n=stiffness, damage_low_n=damage, limits=limits
    )
    assert found >= 0
    reached_n = force + stiffness * found
    assert found == 0 or reached_n <= min(ceiling, damage) * (1 + 1e-9)
