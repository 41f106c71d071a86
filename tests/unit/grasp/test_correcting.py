"""Corrections of the settled force: how far up, and how far down before coming back."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from palpate.estimate.measurement import Measurement
from palpate.grasp.belief import Belief, Closing, Touch
from palpate.grasp.correcting import come_back, eased, pressed_on
from palpate.grasp.plan import Plan
from palpate.grasp.result import GraspResult, Outcome

#: The object of these tests raises the force by this much per millimetre.
N_PER_MM = 2.0


def touch(force_n: float) -> Touch:
    """Return what the sheet of these tests reads at a force: twice as many excess conductances."""
    return Touch(
        time_s=1.0, finger_percent=(-30.0, -30.0), relative_percent=-30.0, reading=2.0 * force_n
    )


def holding(force_n: float) -> Belief:
    """Return the belief of a hand that has squeezed to a force, and knows what it settles to."""
    closures = (20.0, 20.5, 21.0)
    stairs = tuple(
        Closing(closure=each, touch=touch(force_n - N_PER_MM * (21.0 - each))) for each in closures
    )
    settled = Measurement(value=force_n, low=0.9 * force_n, high=1.1 * force_n, unit="n", level=0.9)
    return Belief(
        closure=21.0,
        sent=21.0,
        staircase=stairs,
        touches=(touch(force_n),),
        force_n=force_n,
        force_high_n=1.1 * force_n,
        contact_s=0.5,
        result=GraspResult(outcome=Outcome.STOPPED, force_n=settled),
    )


def test_up_by_what_is_missing(plan: Plan) -> None:
    moved, wish = pressed_on(holding(4.0), plan, missing_n=1.0)
    assert wish is not None
    assert plan.gripper.highest - wish.target == pytest.approx(21.0 + 1.0 / N_PER_MM, abs=0.05)
    assert moved.adjustments == 1
    # An object that still relaxes presses a little harder than it will.
    assert moved.corrected == (21.0, pytest.approx(1.03 * 4.0))


def test_a_correction_that_fell_short_is_believed_down_to_a_quarter_of_the_slope(
    plan: Plan,
) -> None:
    """Half a millimetre raised it by 0.1 N where 1 N was expected: at most four times as far."""
    short = replace(holding(4.0), corrected=(20.5, 3.9))
    _, wish = pressed_on(short, plan, missing_n=0.2)
    assert wish is not None
    assert plan.gripper.highest - wish.target == pytest.approx(
        21.0 + 0.2 / (N_PER_MM / 4.0), abs=0.05
    )


def test_what_raised_nothing_is_not_gone_beyond(plan: Plan) -> None:
    fruitless = replace(holding(4.0), corrected=(20.9, 4.1))
    _, wish = pressed_on(fruitless, plan, missing_n=3.0)
    assert wish is not None
    assert plan.gripper.highest - wish.target == pytest.approx(21.1, abs=0.03)


def test_down_goes_well_below_before_it_comes_back(plan: Plan) -> None:
    belief, command = eased(holding(5.0), plan, goal_n=4.0)
    over_n = 1.03 * 5.0 - 4.0
    again = 21.0 - over_n / N_PER_MM
    assert belief.again == pytest.approx(again, abs=0.05)
    opened = again - 0.3 * 4.0 / N_PER_MM - plan.play
    assert plan.gripper.highest - command.target == pytest.approx(opened, abs=0.05)
    assert belief.force_n == pytest.approx(0.7 * 4.0)
    assert belief.next_forecast_s == 0.0
    assert belief.adjustments == 1


def test_it_comes_back_in_half_a_second_by_what_it_reads(plan: Plan) -> None:
    below = replace(holding(3.0), again=22.0, force_n=0.1, force_high_n=0.1)
    belief, wish = come_back(below, plan)
    assert wish is not None
    assert plan.gripper.highest - wish.target == pytest.approx(22.0, abs=0.05)
    assert wish.rate == pytest.approx(1.0 / 0.5)
    assert belief.force_n == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize("change", [{"touches": ()}, {"again": 21.0}])
def test_it_waits_where_nothing_is_read_yet_and_ends_where_it_is_there(
    plan: Plan, change: dict[str, object]
) -> None:
    below = replace(holding(3.0), **{"again": 22.0, **change})
    belief, wish = come_back(below, plan)
    assert wish is None
    assert belief is below
    assert not math.isnan(belief.again)
