"""Reactions to dangers, and validation of safety limits."""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Literal

import pytest

from palpate.grasp.phases import Phase
from palpate.grasp.safety import (
    FORCE_CEILING_N,
    Danger,
    Reaction,
    SafetyLimits,
    largest_step,
    reaction,
)

#: Danger -> what a width-driven and a pressure-driven hand do in the hold.
IN_THE_HOLD = {
    Danger.SENSOR_LOST: (Reaction.HOLD_STILL, Reaction.OPEN),
    Danger.STOPPED: (Reaction.HOLD_STILL, Reaction.OPEN),
    Danger.GRIPPER_FAULT: (Reaction.HOLD_STILL, Reaction.HOLD_STILL),
    Danger.FORCE_LIMIT: (Reaction.OPEN, Reaction.OPEN),
    Danger.UNSEEN_FORCE: (Reaction.OPEN, Reaction.OPEN),
    Danger.SLIPPED: (Reaction.OPEN, Reaction.OPEN),
    Danger.TIMED_OUT: (Reaction.OPEN, Reaction.OPEN),
}


@pytest.mark.parametrize("danger", list(Danger))
@pytest.mark.parametrize(("column", "drive"), [(0, "width"), (1, "pressure")])
def test_reaction_to_each_danger_matches_table(
    danger: Danger, column: int, drive: Literal["width", "pressure"]
) -> None:
    assert reaction(danger, phase=Phase.HOLD, drive=drive) is IN_THE_HOLD[danger][column]


@pytest.mark.parametrize("danger", [Danger.SENSOR_LOST, Danger.STOPPED])
def test_reaction_to_sensor_loss_or_stop_during_release_is_to_open(danger: Danger) -> None:
    assert reaction(danger, phase=Phase.RELEASE) is Reaction.OPEN


@pytest.mark.parametrize("name", [field.name for field in fields(SafetyLimits)])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan])
def test_safety_limits_not_positive_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{name} must be positive"):
        SafetyLimits(**{name: value})


@pytest.mark.parametrize(("damage_low_n", "step"), [(math.inf, 2.0), (8.0, 0.6), (4.0, 0.0)])
def test_largest_step_ends_at_ceiling_or_damage_limit(damage_low_n: float, step: float) -> None:
    limits = SafetyLimits(force_ceiling_n=15.0)
    found = largest_step(force_high_n=5.0, steepest_n=5.0, damage_low_n=damage_low_n, limits=limits)
    assert found == pytest.approx(step)


def test_stale_after_is_at_least_stale_floor() -> None:
    limits = SafetyLimits()
    assert limits.stale_after_s(1 / 250) == limits.stale_floor_s
    assert limits.stale_after_s(0.1) == pytest.approx(0.5)


def test_a_plan_can_lower_the_ceiling_but_not_raise_it() -> None:
    assert SafetyLimits(force_ceiling_n=3.0).force_ceiling_n == 3.0
    with pytest.raises(ValueError, match="only lower the ceiling"):
        SafetyLimits(force_ceiling_n=FORCE_CEILING_N + 1.0)
