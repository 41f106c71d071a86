"""Stiffness from a closing curve: what every doubt does to the answer and its interval."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.estimate.closing_stiffness import ClosingSteps, object_stiffness
from palpate.estimate.compliance import Compliance
from palpate.estimate.measurement import Measurement

GIVE = Compliance(
    slope_mm_per_n=0.2, pad_mm=(0.0, 0.0, 0.3, 0.0, 0.0), zero_mm=0.0, residual_mm=0.02,
    largest_force_n=15.0,
)  # fmt: skip
STEPS_N = np.array([0.5, 1.0, 1.6, 2.4, 3.4, 4.4, 5.4, 6.4, 7.3, 8.0])
FORCE_N = np.array([0.0, 0.6, 1.2, 2.0, 3.0, 4.5, 6.0])


def answer(
    n_per_mm: float, *, gain: float = 1.0, gain_sd: float = 0.03, touches: tuple[float, ...] = ()
) -> Measurement:
    """Close on a spring; `gain` falsifies every force, `touches` are drift before the contact."""
    opening = 40.0 - FORCE_N / n_per_mm - GIVE.give_mm(FORCE_N)
    before = 40.0 + np.arange(len(touches), 0, -1)
    curve = ClosingSteps(
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


def test_what_relaxed_unseen_is_inside_though_the_force_was_sure() -> None:
    opening = 40.0 - FORCE_N / 2.0 - GIVE.give_mm(FORCE_N)
    curve = ClosingSteps(width_mm=opening, force_n=FORCE_N, gain_sd=0.01, law_sd=0.03, floor_n=0.05)
    said = Measurement(value=6.0, low=5.9, high=6.1, unit="n", level=0.9)
    found = object_stiffness(curve, give=GIVE, opening_mm=float(opening[-1]), force=said)
    # A fruit lost 6 % of its force and nobody felt it; the fingers came that much nearer to it.
    left_n = 0.94 * 6.0
    relaxed = left_n / float(40.0 - opening[-1] - GIVE.give_mm(left_n))
    assert found.low < relaxed < 0.95 * 2.0 < 2.0 < found.high


def test_doubt_of_the_gain_widens_the_interval_until_it_covers() -> None:
    sure, unsure = answer(2.0, gain=1.3), answer(2.0, gain=1.3, gain_sd=0.3)
    assert sure.low > 2.0
    assert unsure.low < 2.0 < unsure.high


def read_as(
    read_n: np.ndarray, *, n_per_mm: float, law_sd: float
) -> tuple[Measurement, ClosingSteps]:
    """Close on a spring in many steps, with forces read as given; the last one is right."""
    opening = 40.0 - STEPS_N / n_per_mm - GIVE.give_mm(STEPS_N)
    curve = ClosingSteps(width_mm=opening, force_n=read_n, gain_sd=0.03, law_sd=law_sd, floor_n=0.1)
    held = Measurement(value=8.0, low=7.6, high=8.4, unit="n", level=0.9)
    found = object_stiffness(curve, give=GIVE, opening_mm=float(opening[-1]), force=held)
    assert found is not None
    return found, curve


def test_a_sheet_that_lags_behind_its_steps_is_seen_through() -> None:
    straight, curve = read_as(STEPS_N, n_per_mm=4.0, law_sd=0.05)
    lagging = np.zeros_like(STEPS_N)
    lagging[curve.felt] = 0.25 * (curve.rising - curve.rising[-1])
    behind, _ = read_as(STEPS_N * np.exp(-lagging), n_per_mm=4.0, law_sd=0.05)
    assert behind.low < 4.0 < behind.high
    assert behind.value == pytest.approx(straight.value, rel=0.15)


def test_a_law_that_scatters_leaves_the_exponent_open() -> None:
    bent_n = STEPS_N * (STEPS_N / 8.0) ** 0.3
    trusted, doubted = (read_as(bent_n, n_per_mm=2.0, law_sd=sd)[0] for sd in (0.05, 0.8))
    assert doubted.low < 2.0 < doubted.high
    assert doubted.high / doubted.low > 1.05 * trusted.high / trusted.low


def test_what_is_looked_at_is_counted_from_where_the_gain_was_told() -> None:
    _, curve = read_as(STEPS_N, n_per_mm=4.0, law_sd=0.05)
    looks = curve.looks
    share = looks.read_n / 8.0
    told = np.where(share > 0.3, share**2, 0.0)
    assert looks.above @ told == pytest.approx(0.0, abs=1e-9)
    assert looks.lagging[-1] == 0.0
    assert looks.lagging[0] > 0.0
    assert looks.above[-1] > 0


def test_drift_before_the_contact_is_not_taken_for_softness() -> None:
    assert answer(20.0, touches=(0.12, 0.12)).high > 20.0


def test_same_touch_same_answer() -> None:
    assert answer(3.0) == answer(3.0)


def test_one_step_is_not_enough() -> None:
    curve = ClosingSteps(
        width_mm=np.array([41.0, 40.0]),
        force_n=np.array([0.0, 2.0]),
        gain_sd=0.1,
        law_sd=0.1,
        floor_n=0.05,
    )
    held = Measurement(value=2.0, low=1.8, high=2.2, unit="n", level=0.9)
    assert object_stiffness(curve, give=GIVE, opening_mm=39.0, force=held) is None
