"""End of a squeeze without target: stiffness known, or the object yields."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

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


def squeezed(plan: Plan, bench: Any, n_per_mm: float) -> tuple[GraspResult, float]:
    """Grasp a spring; return the result and the largest force of the squeeze."""
    result, _, most_n = grasped(plan, bench, n_per_mm)
    return result, most_n


@pytest.mark.parametrize(
    ("n_per_mm", "why"),
    [(0.4, "gave_way"), (3.0, "firm_enough"), (10.0, "firm_enough"), (60.0, "stiffness_known")],
)
def test_gentle_squeeze_records_its_end_reason(
    plan: Plan, bench: Any, n_per_mm: float, why: str
) -> None:
    result, _ = squeezed(plan, bench, n_per_mm)
    ends = {"gave_way", "firm_enough", "stiffness_known", "force_reached"}
    assert [moment.name for moment in result.moments if moment.name in ends] == [why]


def test_squeeze_to_target_records_no_reason(plan: Plan, bench: Any) -> None:
    result, _ = squeezed(replace(plan, target_force_n=3.0), bench, 2.0)
    assert "firm_enough" not in {moment.name for moment in result.moments}


@pytest.mark.parametrize("n_per_mm", [0.4, 0.7, 1.2])
def test_gentle_squeeze_of_soft_object_stops_at_deformation_limit(
    plan: Plan, bench: Any, n_per_mm: float
) -> None:
    """The deformation is at most 1 mm, or that of the contact at speed."""
    result, touch_n, most_n = grasped(plan, bench, n_per_mm)
    assert most_n <= max(n_per_mm * (plan.gentle_mm + plan.fine_step), 1.05 * touch_n)
    assert most_n < 0.9 * plan.gentle_force_n
    assert result.stiffness_n_per_mm is not None


def test_gentle_squeeze_with_lift_reaches_lift_force(plan: Plan, bench: Any) -> None:
    _, most_n = squeezed(replace(plan, lift_force_n=0.5), bench, 0.4)
    assert most_n >= plan.gentle_force_n


def test_gentle_squeeze_of_stiff_object_continues_until_stiffness_known(
    plan: Plan, bench: Any
) -> None:
    """2 N does not determine the stiffness; a larger permitted force does."""
    soon = replace(plan, firm_force_n=0.0)
    before, gentle_n = squeezed(soon, bench, 10.0)
    after, firm_n = squeezed(plan, type(bench)(), 10.0)
    assert gentle_n < firm_n <= 1.2 * plan.firm_force_n
    assert firm_n / 10.0 <= plan.firm_mm
    wide, narrow = (
        found.stiffness_n_per_mm.high / found.stiffness_n_per_mm.low
        for found in (before, after)
        if found.stiffness_n_per_mm is not None
    )
    assert narrow < wide


@pytest.mark.parametrize("n_per_mm", [0.4, 2.0, 5.0, 50.0])
def test_gentle_squeeze_of_firm_object_stops_near_firm_force(
    plan: Plan, bench: Any, n_per_mm: float
) -> None:
    _, most_n = squeezed(plan, bench, n_per_mm)
    assert most_n <= 1.2 * plan.firm_force_n
