"""Whatever the sensor says, the controller stays within its bounds, and ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.estimate.force import PowerForceLaw
from palpate.estimate.stiffness import Give
from palpate.grasp.belief import Belief, Observation
from palpate.grasp.controller import step
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.safety import SafetyLimits, largest_step
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.sensor.array import ArrayLayout, Frame
from palpate.settling.recorded import Recorded

LIMITS = GripperLimits(drive="width", lowest=20.0, highest=40.0, fastest=60.0)
LAYOUT = ArrayLayout(name="two", rows=2, cols=1, finger_of_row=(0, 1))
FORCE = np.array([0.3, 0.6, 1.2, 2.5, 5.0, 10.0])
LAW = PowerForceLaw.fit(2 * FORCE, force_n=FORCE * np.exp([0.1, -0.1] * 3))
GIVE = Give.fit(FORCE, width_mm=40 - 0.2 * FORCE, block_mm=40.0)
PLAN = Plan(
    layout=LAYOUT,
    rest_ohm=np.full((2, 1), 9000.0),
    settled_law=LAW,
    early_law=LAW,
    give=GIVE,
    steepest_n=GIVE.stiffest_n_per_mm,
    gripper=LIMITS,
    settling=Recorded(),
    longest_s=30.0,
)

plans = st.builds(
    lambda ceiling, target, step: replace(
        PLAN,
        safety=SafetyLimits(force_ceiling_n=ceiling),
        target_force_n=target,
        step=step,
    ),
    st.floats(0.5, 30.0),
    st.none() | st.floats(0.5, 15.0),
    st.floats(0.2, 5.0),
)


@given(plan=plans, counts=st.lists(st.integers(0, 1023), min_size=1, max_size=40), data=st.data())
@settings(max_examples=60, deadline=None)
def test_any_readings_any_plan(plan: Plan, counts: list[int], data: st.DataObject) -> None:
    """Readings are noise on a gripper that obeys: commands are bounded, and the grasp ends."""
    sticks = data.draw(st.booleans())
    belief, width, rest = Belief(), LIMITS.highest, 350
    for index in range(int((plan.longest_s + 12.0) * 15)):
        reading = rest if index < 10 else counts[(index // 5) % len(counts)]
        frame = Frame(time_s=index / 15, sequence=index, counts=np.full((2, 1), reading))
        state = GripperState(time_s=index / 15, width_mm=width)
        belief, command = step(belief, Observation(frame=frame, gripper=state), plan=plan)
        if belief.ended:
            assert command is None
            break
        if command is None:
            continue
        assert LIMITS.lowest <= command.target <= LIMITS.highest
        assert 0 < command.rate <= LIMITS.fastest
        closing = width - command.target
        if closing > 0:
            overrun = command.rate * plan.safety.latency_s
            upper_n = belief.force_high_n + (closing + overrun) * plan.steepest_n
            assert upper_n <= plan.safety.force_ceiling_n * (1 + 1e-9)
            assert belief.phase is not Phase.RELEASE
        width = width if sticks else command.target
    assert belief.ended


@given(
    force=st.floats(0, 100),
    stiffness=st.floats(0.01, 100),
    ceiling=st.floats(0.1, 100),
    damage=st.floats(0.1, 100) | st.just(float("inf")),
    rate=st.floats(0.1, 60),
)
def test_largest_step_keeps_the_invariant(
    force: float, stiffness: float, ceiling: float, damage: float, rate: float
) -> None:
    limits = SafetyLimits(force_ceiling_n=ceiling)
    found = largest_step(
        force_high_n=force, steepest_n=stiffness, rate=rate, damage_low_n=damage, limits=limits
    )
    assert found >= 0
    reached_n = force + stiffness * (found + rate * limits.latency_s)
    assert found == 0 or reached_n <= min(ceiling, damage) * (1 + 1e-9)


@pytest.mark.parametrize("field", ["force_ceiling_n", "stale_periods", "stale_floor_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan")])
def test_limits_refuse_nonsense(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        SafetyLimits(**{field: value})
