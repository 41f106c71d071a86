"""How far the hand closes on while it does not know yet what the object bears."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.estimate.damage import DamageModel
from palpate.grasp.config import SQUEEZE
from palpate.grasp.estimator import ClosingStep, ContactEstimate, Touch
from palpate.grasp.plan import Plan
from palpate.grasp.safety_filter import filter_command
from palpate.grasp.step_size import close_by
from palpate.gripper.interface import GripperCommand


def felt(*, first: float, second: float, force_n: float) -> ContactEstimate:
    """Return the estimate of a hand that has closed by a millimetre while its fingers felt this."""
    touch = Touch(
        time_s=1.0,
        finger_percent=(first, second),
        relative_percent=(first + second) / 2,
        reading=2.0 * force_n,
    )
    stairs = tuple(ClosingStep(closure=20.0 + 0.25 * each, touch=touch) for each in range(5))
    return ContactEstimate(closure=21.0, sent=21.0, steps=stairs, force_high_n=1.5 * force_n)


@pytest.mark.parametrize(
    ("first", "second", "force_n", "goes_on"),
    [
        (-5.0, -0.2, 0.9, True),  # one finger alone pushes the object to the middle
        (-5.0, -2.0, 0.9, False),  # both feel it: it is squeezed
        (-5.0, -0.2, 1.2, False),  # so much that no push takes it
    ],
)
def test_one_finger_alone_does_not_squeeze(
    plan: Plan, damage: DamageModel, first: float, second: float, force_n: float, goes_on: bool
) -> None:
    careful = replace(plan, damage=damage, target_force_n=4.0)
    estimate = felt(first=first, second=second, force_n=force_n)
    assert (close_by(estimate, 0.25, careful) is not None) == goes_on


def test_step_from_the_first_touch_is_no_longer_than_what_the_softest_fruit_shows(
    plan: Plan, damage: DamageModel
) -> None:
    careful = replace(plan, damage=damage, target_force_n=4.0)
    begun = felt(first=-5.0, second=-5.0, force_n=0.9)
    touched = replace(begun, steps=begun.steps[:1], closure=20.0, sent=20.0)
    command = filter_command(GripperCommand(target=50.0, rate=5.0), touched, careful)
    way_mm = careful.gripper.highest - 20.0 - command.target
    longest_mm = 2 * SQUEEZE.sure_n * (1.0 / careful.steepest_n + 1.0 / SQUEEZE.soft_n_per_mm)
    assert longest_mm - 2 * careful.resolution <= way_mm <= longest_mm
