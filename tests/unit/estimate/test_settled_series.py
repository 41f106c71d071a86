"""Stiffness from a series of grasps of one object: the curve through where they ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.estimate.measurement import Measurement
from palpate.estimate.object_law import SHAPES
from palpate.estimate.settled_series import SettledPoint, series_stiffness
from palpate.estimate.stiffness import Give

GIVE = Give(
    slope_mm_per_n=0.25,
    pad_mm=(0.1, 0.0, 0.2, 0.0, 0.0),
    zero_mm=0.0,
    residual_mm=0.02,
    largest_force_n=15.0,
)
FORCES_N = (2.0, 4.0, 6.0, 8.0, 10.0)


def points_of(
    *, scale: float, shape: float, gain: float = 1.0, told: Measurement | None = None
) -> list[SettledPoint]:
    """Return where grasps of an object of 40 mm end, read with one gain for all of them."""
    return [
        SettledPoint(
            opening_mm=40.0 - float(GIVE.give_mm(n)) - (n / scale) ** (1 / shape),
            force=Measurement(value=gain * n, low=gain * n / 1.1, high=gain * n * 1.1, unit="n"),
            stiffness=told,
        )
        for n in FORCES_N
    ]


def secant(*, scale: float, shape: float, force_n: float = FORCES_N[-1]) -> float:
    """Return the true secant stiffness at a force."""
    return float(force_n / (force_n / scale) ** (1 / shape))


@given(
    scale=st.floats(0.5, 10.0),
    shape=st.sampled_from(sorted(SHAPES)),
    gain=st.floats(0.95, 1.05),
)
def test_the_true_stiffness_lies_within(scale: float, shape: float, gain: float) -> None:
    found = series_stiffness(points_of(scale=scale, shape=shape, gain=gain), give=GIVE)

    assert found is not None
    assert found.low < secant(scale=scale, shape=shape) < found.high
    assert found.unit == "n_per_mm"


def test_the_bend_of_the_curve_tells_a_round_thing_from_a_flat_one() -> None:
    flat = series_stiffness(points_of(scale=2.0, shape=1.0), give=GIVE)
    round_ = series_stiffness(points_of(scale=2.0, shape=1.5), give=GIVE)

    assert flat is not None
    assert round_ is not None
    assert flat.value == pytest.approx(2.0, rel=0.05)
    assert round_.value == pytest.approx(secant(scale=2.0, shape=1.5), rel=0.1)


def test_the_order_of_the_grasps_does_not_matter() -> None:
    points = points_of(scale=2.0, shape=1.0)

    assert series_stiffness(points[::-1], give=GIVE) == series_stiffness(points, give=GIVE)


def test_the_closing_of_the_firmest_grasp_is_a_second_witness() -> None:
    alone = series_stiffness(points_of(scale=2.0, shape=1.0), give=GIVE)
    told = Measurement(value=3.0, low=2.7, high=3.3, unit="n_per_mm")

    both = series_stiffness(points_of(scale=2.0, shape=1.0, told=told), give=GIVE)

    assert alone is not None
    assert both is not None
    assert alone.value < both.value < told.value
    assert np.log(both.high / both.low) < np.log(alone.high / alone.low)


def test_doubted_forces_leave_the_stiffness_doubted() -> None:
    sure = points_of(scale=2.0, shape=1.0)
    doubted = [
        replace(
            one,
            force=replace(one.force, low=one.force.value / 1.4, high=one.force.value * 1.4),
        )
        for one in sure
    ]

    narrow, wide = (series_stiffness(points, give=GIVE) for points in (sure, doubted))

    assert narrow is not None
    assert wide is not None
    assert wide.high / wide.low > 1.5 * narrow.high / narrow.low


@pytest.mark.parametrize("kept", [slice(0, 2), slice(4, 5), slice(0, 0)])
def test_too_few_points_are_no_curve(kept: slice) -> None:
    assert series_stiffness(points_of(scale=2.0, shape=1.0)[kept], give=GIVE) is None


def test_equal_forces_are_no_curve() -> None:
    points = points_of(scale=2.0, shape=1.0)

    assert series_stiffness([points[2]] * 5, give=GIVE) is None


def test_a_force_of_nothing_is_left_out() -> None:
    points = points_of(scale=2.0, shape=1.0)
    nothing = Measurement(value=0.0, low=0.0, high=0.3, unit="n")
    empty = SettledPoint(opening_mm=41.0, force=nothing)

    assert series_stiffness([empty, *points], give=GIVE) == series_stiffness(points, give=GIVE)
