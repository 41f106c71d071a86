"""Conversion between servo angle and finger opening of the slider-crank."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.gripper.fingers import CrankFingers

angles = st.floats(-1.5, 1.5)
mechanisms = st.builds(
    lambda horn, more, offset: CrankFingers(horn_mm=horn, arm_mm=horn + more, offset_mm=offset),
    st.floats(5.0, 30.0),
    st.floats(1.0, 30.0),
    st.floats(-20.0, 20.0),
)


@given(fingers=mechanisms, angle=angles)
def test_crank_fingers_angle_of_width_roundtrips(fingers: CrankFingers, angle: float) -> None:
    assert fingers.angle_rad(fingers.width_mm(angle)) == pytest.approx(angle, abs=1e-5)


@given(fingers=mechanisms, angle=angles)
def test_crank_fingers_slope_equals_the_numerical_derivative(
    fingers: CrankFingers, angle: float
) -> None:
    step = 1e-6
    numeric = (fingers.width_mm(angle + step) - fingers.width_mm(angle - step)) / (2 * step)
    width = fingers.width_mm(angle)
    assert fingers.max_mm_per_rad(width, width) == pytest.approx(numeric, rel=1e-3, abs=1e-3)


@given(fingers=mechanisms, one=angles, other=angles)
def test_crank_fingers_maximum_slope_bounds_any_movement(
    fingers: CrankFingers, one: float, other: float
) -> None:
    first, last = fingers.width_mm(one), fingers.width_mm(other)
    max_slope = fingers.max_mm_per_rad(first, last)
    assert abs(first - last) <= max_slope * abs(one - other) * 1.05 + 1e-6


def test_crank_fingers_default_has_the_range_of_the_widowx() -> None:
    fingers = CrankFingers()
    assert fingers.range_mm == (20.0, 76.0)
    assert fingers.width_mm(0.0) == pytest.approx(2 * math.sqrt(24**2 - 14**2))
    with pytest.raises(ValueError, match="outside the fingers' range of 20 to 76 mm"):
        fingers.angle_rad(80.0)
    with pytest.raises(ValueError, match="horn"):
        CrankFingers(horn_mm=30.0)
