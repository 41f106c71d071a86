"""Force from closure, its distribution over pixels and its relaxation, by hand calculations."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
from palpate.twin.mechanics import (
    HandCompliance,
    RelaxingForce,
    object_force_n,
    pixel_fractions,
    series_force_n,
)
from palpate.twin.objects import TwinObject, draw_object
from palpate.twin.placement import PixelGrid

#: A linear spring.
THING = TwinObject(
    name="thing",
    size_mm=40.0,
    contact="linear",
    force_at_1mm_n=4.0,
    relaxing_fractions=(),
    relaxing_time_s=(),
    flat=True,
)
PADS = HandCompliance(finger_mm_per_n=0.2, pad_travel_mm=0.4, pad_force_n=2.0)


@pytest.mark.parametrize("name", ["strawberry", "springs-4", "dragonskin-20"])
def test_series_force_deformations_sum_to_closure(name: str) -> None:
    obj = draw_object(np.random.default_rng(5), name)
    for closure_mm in (0.01, 0.5, 2.0, 6.0, 20.0):
        force_n = series_force_n(obj, closure_mm, compliance=PADS)
        deformation_mm = closure_mm - PADS.deflection_mm(force_n)
        expected_n, _ = object_force_n(obj, deformation_mm, ruptured=False)
        assert expected_n == pytest.approx(force_n, rel=1e-6)


@pytest.mark.parametrize("layout", [RIGID_LAYOUT, SOFT_LAYOUT])
@pytest.mark.parametrize("flat", [True, False])
def test_pixel_fractions_sum_to_one_per_finger(layout: ArrayLayout, flat: bool) -> None:
    grid = PixelGrid.from_layout(layout)
    for spot in [(0.0, 0.0), (6.0, -6.0)]:
        fractions = pixel_fractions(replace(THING, flat=flat), 2.0, grid=grid, off_centre_mm=spot)
        assert np.all(fractions >= 0)
        for finger in range(layout.fingers):
            assert fractions[layout.finger_mask(finger).ravel()].sum() == pytest.approx(1.0)


STIFF = HandCompliance(finger_mm_per_n=1e-9, pad_travel_mm=1e-9, pad_force_n=1.0)
SOFT = HandCompliance(finger_mm_per_n=1e3, pad_travel_mm=1e-9, pad_force_n=1.0)


def make_fruit(fraction: float = 0.3) -> TwinObject:
    return replace(THING, size_mm=50.0, relaxing_fractions=(fraction,), relaxing_time_s=(2.0,))


def hold_closure(
    obj: TwinObject, closure_mm: float, *, compliance: HandCompliance, until_s: float
) -> RelaxingForce:
    """Return the force after a sudden closure and a hold in small steps."""
    squeeze = RelaxingForce.at_rest(obj)
    for step_s in (1e-9, *[until_s / 399] * 399):
        squeeze = squeeze.close_to(obj, closure_mm, step_s=step_s, compliance=compliance)
    return squeeze


@pytest.mark.parametrize("at_s", [0.5, 8.0])
def test_relaxing_force_at_constant_closure_decays(at_s: float) -> None:
    squeeze = hold_closure(make_fruit(), 2.0, compliance=STIFF, until_s=at_s)
    assert squeeze.elastic_n == pytest.approx(8.0, rel=1e-6)
    assert squeeze.force_n == pytest.approx(8.0 * (0.7 + 0.3 * math.exp(-at_s / 2.0)), rel=1e-5)


@pytest.mark.parametrize("at_s", [0.5, 8.0])
def test_relaxing_force_under_constant_load_creeps(at_s: float) -> None:
    # A standard linear solid under constant force: J(t) = 1 + s/(1-s) (1 - exp(-(1-s) t / tau)).
    closure_mm = 1e3 * 2.0
    squeeze = hold_closure(make_fruit(), closure_mm, compliance=SOFT, until_s=at_s)
    crept = 1.0 + 0.3 / 0.7 * -math.expm1(-0.7 * at_s / 2.0)
    assert squeeze.force_n == pytest.approx(2.0, rel=2e-3)
    assert squeeze.elastic_n == pytest.approx(2.0 * crept, rel=3e-3)


@pytest.mark.slow
@given(
    fraction=st.floats(0.0, 0.5),
    closure=st.floats(0.1, 4.0),
    compliance_mm_per_n=st.floats(0.0, 5.0),
)
def test_relaxing_force_decreases_with_time(
    fraction: float, closure: float, compliance_mm_per_n: float
) -> None:
    compliance = HandCompliance(
        finger_mm_per_n=compliance_mm_per_n, pad_travel_mm=0.3, pad_force_n=2.0
    )
    obj = make_fruit(fraction)
    early = hold_closure(obj, closure, compliance=compliance, until_s=0.5)
    late = hold_closure(obj, closure, compliance=compliance, until_s=20.0)
    assert 0.0 < late.force_n <= early.force_n * (1 + 1e-9)
    assert late.elastic_n >= early.elastic_n * (1 - 1e-9)
