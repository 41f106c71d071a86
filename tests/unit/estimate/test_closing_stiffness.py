"""Stiffness from a closing curve: what every doubt does to the answer and its interval."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.closing_steps import ClosingCurve
from palpate.estimate.closing_stiffness import object_stiffness
from palpate.estimate.measurement import Measurement
from palpate.estimate.stiffness import Give

GIVE = Give(
    slope_mm_per_n=0.2, pad_mm=(0.0, 0.0, 0.3, 0.0, 0.0), zero_mm=0.0, residual_mm=0.02,
    largest_force_n=15.0,
)  # fmt: skip
FORCE_N = np.array([0.0, 0.6, 1.2, 2.0, 3.0, 4.5, 6.0])


def answer(
    n_per_mm: float, *, gain: float = 1.0, gain_sd: float = 0.03, touches: tuple[float, ...] = ()
) -> Measurement:
    """Close on a spring; `gain` falsifies every force, `touches` are drift before the contact."""
    opening = 40.0 - FORCE_N / n_per_mm - GIVE.give_mm(FORCE_N)
    before = 40.0 + np.arange(len(touches), 0, -1)
    curve = ClosingCurve(
        width_mm=np.concatenate([before, opening]),
        force_n=np.concatenate([touches, gain * FORCE_N]),
        gain_sd=gain_sd,
        law_sd=0.05,
        floor_n=0.1,
    )
    held_n = gain * FORCE_N[-1]
    wide = np.exp(1.645 * np.hypot(gain_sd, 0.03))
    held = Measurement(value=held_n, low=held_n / wide, high=held_n * wide, unit="n", level=0.9)
    found = object_stiffness(curve, give=GIVE, opening_mm=float(opening[-1]), force=held)
    assert found is not None
    return found


@pytest.mark.parametrize("n_per_mm", [0.5, 1.5, 4.0])
def test_soft_objects_are_found_within_a_tenth(n_per_mm: float) -> None:
    found = answer(n_per_mm)
    assert found.value == pytest.approx(n_per_mm, rel=0.1)
    assert found.low < n_per_mm < found.high
    assert found.high / found.low < 2


def test_what_is_stiffer_than_the_gripper_is_told_less_well() -> None:
    soft, stiff = answer(1.5), answer(30.0)
    assert np.log(stiff.high / stiff.low) > 3 * np.log(soft.high / soft.low)
    assert stiff.low < 30.0 < stiff.high


def test_doubt_of_the_gain_widens_the_interval_until_it_covers() -> None:
    sure, unsure = answer(2.0, gain=1.3), answer(2.0, gain=1.3, gain_sd=0.3)
    assert sure.low > 2.0
    assert unsure.low < 2.0 < unsure.high


def test_drift_before_the_contact_is_not_taken_for_softness() -> None:
    assert answer(20.0, touches=(0.12, 0.12)).high > 20.0


def test_same_touch_same_answer() -> None:
    assert answer(3.0) == answer(3.0)


def test_one_step_is_not_enough() -> None:
    curve = ClosingCurve(
        width_mm=np.array([41.0, 40.0]),
        force_n=np.array([0.0, 2.0]),
        gain_sd=0.1,
        law_sd=0.1,
        floor_n=0.05,
    )
    held = Measurement(value=2.0, low=1.8, high=2.2, unit="n", level=0.9)
    assert object_stiffness(curve, give=GIVE, opening_mm=39.0, force=held) is None
