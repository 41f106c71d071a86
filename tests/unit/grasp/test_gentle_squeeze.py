"""End of a squeeze without target: stiffness known, or the object yields."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
from tests.factories import closing_steps

from palpate.grasp.config import SQUEEZE
from palpate.grasp.controller import squeeze
from palpate.grasp.estimator import ContactEstimate
from palpate.grasp.phases import Activity, Phase
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.state import GraspState

_SQUEEZING = (Phase.SQUEEZE, Activity.FORECAST, Phase.HOLD)


def grasped(plan: Plan, bench: Any, n_per_mm: float) -> tuple[GraspResult, float, float]:
    """Grasp a spring; return the result and peak forces of contact and squeeze."""
    # At this size the contact at speed is light.
    bench.n_per_mm, bench.size_mm = n_per_mm, 51.2
    touch_n, squeeze_n = [0.0], [0.0]

    def watch(grasp_state: GraspState) -> None:
        if grasp_state.phase is not Phase.RELEASE:
            (squeeze_n if grasp_state.activity in _SQUEEZING else touch_n).append(bench.force_n)

    result = bench.grasp(plan, watchers=[watch])
    assert result.outcome is Outcome.HELD
    return result, max(touch_n), max(squeeze_n)


@pytest.mark.parametrize(
    ("n_per_mm", "why"),
    [
        (0.4, "gave_way"),
        (0.7, None),
        (1.2, None),
        (2.0, None),
        (3.0, "firm_enough"),
        (10.0, "firm_enough"),
        (60.0, "stiffness_known"),
    ],
)
def test_gentle_squeeze_ends_by_deformation_or_firm_force_with_its_reason(
    plan: Plan, bench: Any, n_per_mm: float, why: str | None
) -> None:
    """A soft object deforms by at most 1 mm, or by as much as in the contact at speed."""
    result, touch_n, most_n = grasped(plan, bench, n_per_mm)
    ends = {"gave_way", "firm_enough", "stiffness_known", "force_reached"}
    found = [moment.name for moment in result.moments if moment.name in ends]
    assert found == [why] if why else len(found) == 1
    assert most_n <= 1.2 * plan.firm_force_n
    if n_per_mm <= 1.2:
        assert most_n <= max(n_per_mm * (plan.gentle_mm + plan.fine_step), 1.05 * touch_n)
        assert most_n < 0.9 * plan.gentle_force_n
        assert result.stiffness_n_per_mm is not None


def test_gentle_squeeze_of_stiff_object_continues_until_stiffness_known(
    plan: Plan, bench: Any
) -> None:
    """2 N does not determine the stiffness; a larger permitted force does."""
    before, _, gentle_n = grasped(replace(plan, firm_force_n=0.0), bench, 10.0)
    after, _, firm_n = grasped(plan, type(bench)(), 10.0)
    assert gentle_n < firm_n
    assert firm_n / 10.0 <= SQUEEZE.firm_mm
    wide, narrow = (
        found.stiffness_n_per_mm.high / found.stiffness_n_per_mm.low for found in (before, after)
    )
    assert narrow < wide


@pytest.mark.parametrize(
    ("forces_n", "wish", "closes"),
    [
        # A soft object has deformed by 1 mm, or the target is reached.
        ((0.0, 0.4, 0.8), {}, False),
        ((0.0, 1.5, 2.0 * SQUEEZE.near_fraction), {"target_force_n": 2.0}, False),
        # The force is reached, but too few steps measure the stiffness.
        ((0.0, 1.5, 3.0), {"lift_force_n": 0.5}, True),
    ],
)
def test_squeeze_of_few_steps_continues_only_to_measure_the_stiffness(
    plan: Plan,
    forces_n: tuple[float, ...],
    wish: dict[str, float],
    closes: bool,
) -> None:
    steps = closing_steps(forces_n, step_mm=1.0)
    estimate = ContactEstimate(
        steps=steps,
        touches=(steps[-1].touch,),
        contact_s=0.0,
        closure=steps[-1].closure,
        sent=steps[-1].closure,
        force_n=forces_n[-1],
        force_high_n=1.1 * forces_n[-1],
        still_since_s=2.0,
        now_s=3.0,
    )
    state = GraspState(phase=Phase.SQUEEZE, estimate=estimate)
    command = squeeze(state, replace(plan, **wish))
    assert (command is not None) == closes
    assert (state.phase is Phase.SQUEEZE) == closes
