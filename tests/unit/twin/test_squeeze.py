"""A relaxing object at constant closure and at constant force."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from palpate.twin.mechanics import HandCompliance, RelaxingForce
from palpate.twin.objects import TwinObject
from palpate.twin.world import World

STIFF = HandCompliance(finger_mm_per_n=1e-9, pad_travel_mm=1e-9, pad_force_n=1.0)
SOFT = HandCompliance(finger_mm_per_n=1e3, pad_travel_mm=1e-9, pad_force_n=1.0)


def make_fruit(fraction: float = 0.3, *, tau_s: float = 2.0) -> TwinObject:
    return TwinObject(
        name="fruit",
        size_mm=50.0,
        contact="linear",
        force_at_1mm_n=4.0,
        relaxing_fractions=(fraction,),
        relaxing_time_s=(tau_s,),
        flat=True,
    )


def hold_closure(
    obj: TwinObject, closure_mm: float, *, compliance: HandCompliance, until_s: float
) -> RelaxingForce:
    """Return the force after a sudden closure and a hold in small steps."""
    squeeze = RelaxingForce.at_rest(obj).close_to(
        obj, closure_mm, step_s=1e-9, compliance=compliance
    )
    for start, end in pairwise(np.linspace(0.0, until_s, 400)):
        step_s = float(end - start)
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
@settings(deadline=None)
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


def test_soft_fingers_lose_less_force_to_relaxation_than_rigid() -> None:
    def lost(world: World, target: float) -> float:
        world.drive(target, rate=60.0)
        world.clock.sleep_s(0.6)
        early_n = world.force_n(0.6)
        return 1.0 - world.force_n(30.0) / early_n

    soft = lost(World(make_fruit(), seed=1, gripper="soft"), 26.0)
    assert 0.01 < soft < 0.5 * lost(World(make_fruit(), seed=1), 47.0)
