"""Contact point on curves whose truth is known, also through a law in doubt; compliance."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.errors import CalibrationError
from palpate.estimate.compliance import Compliance
from palpate.estimate.size import ContactPoint, contact_point


@pytest.mark.parametrize("exponent", [1.0, 1.5])
def test_contact_point_covers_scattered_curves(exponent: float) -> None:
    rng = np.random.default_rng(7)
    inside, errors = [], []
    for _ in range(60):
        size = rng.uniform(30, 31)
        width = 33.0 - np.cumsum([1, 1, 1, 0.5, 0.5, 0.4])
        true = 2.0 * np.maximum(size - width, 0) ** exponent
        force = true * np.exp(0.05 * rng.standard_normal(width.size)) * (true > 0.1)
        found = contact_point(width, force_n=force, give_mm=0 * width, floor_n=0.1)
        low, middle, high = found.quantile([0.05, 0.5, 0.95])
        inside.append(low <= size <= high)
        errors.append(middle - size)
    assert np.mean(inside) >= 0.85
    assert np.sqrt(np.mean(np.square(errors))) < 0.28


def test_contact_point_does_not_depend_on_the_gain() -> None:
    width = np.array([31.0, 30.0, 29.5, 29.0])
    force = 2.0 * np.maximum(30.4 - width, 0)
    weak, strong = (
        contact_point(width, force_n=g * force, give_mm=0 * width, floor_n=g * 0.05).quantile(0.5)
        for g in (0.5, 2.0)
    )
    assert weak == pytest.approx(strong)


def test_contact_point_needs_a_touch() -> None:
    with pytest.raises(ValueError, match="no step of the curve has a force"):
        contact_point([30.0, 29.0], force_n=[0.0, 0.0], give_mm=[0.0, 0.0], floor_n=0.1)


def test_give_takes_pads_and_zero_out() -> None:
    force = np.linspace(0.2, 15, 25)
    true = 0.22 * force + 0.3 * -np.expm1(-force / 2.3)
    give = Compliance.fit(force, width_mm=40.0 - true - 0.1, block_mm=40.0)
    np.testing.assert_allclose(give.give_mm(force), true, atol=0.03)
    assert give.zero_mm == pytest.approx(-0.1, abs=0.03)
    assert 1 / give.stiffest_n_per_mm == pytest.approx(0.22, rel=0.03)


@pytest.mark.parametrize(
    "width", [[40.0, 40.0, 40.0, 40.0], [38.0, 38.5, 39.0, 40.0], [40.0, 39.0]]
)
def test_give_refuses_what_is_no_block(width: list[float]) -> None:
    force = np.arange(1.0, len(width) + 1)
    with pytest.raises(CalibrationError, match="is the block rigid"):
        Compliance.fit(force, width_mm=width, block_mm=40.0)


def test_stiff_object_found_by_a_whole_step() -> None:
    """Before the last step it was touched, but the gripper's give kept the force unfelt."""
    size, n_per_mm, give = 40.0, 36.0, 0.35
    width = np.array([40.9, 39.9, 38.9, 38.7, 38.5])
    force = np.maximum(size - width, 0.0) / (1 / n_per_mm + give)
    force = np.where(force > 0.3, force, 0.0)
    found = contact_point(width, force_n=force, give_mm=give * force, floor_n=0.3)
    assert abs(float(found.quantile(0.5)) - size) < 0.1


def test_mixture_weighs_its_parts() -> None:
    narrow, other = (
        ContactPoint(size_mm=np.array([at, at + 0.1]), weight=np.array([0.5, 0.5]))
        for at in (30.0, 32.0)
    )
    mixed = ContactPoint.mixture([other, narrow], weights=[0.25, 0.75])
    assert mixed.size_mm.tolist() == [30.0, 30.1, 32.0, 32.1]
    assert mixed.weight.tolist() == [0.375, 0.375, 0.125, 0.125]
    assert float(mixed.quantile(0.5)) < 31.0 < float(mixed.quantile(0.9))


def interval(size: float, *, exponent: float, law: float, felt_n: float) -> tuple[float, float]:
    """Close on an object as a grasp does, read it through a law, and return the interval."""
    width = np.array([34.0, 33.0, 32.0, 31.0, 30.6, 30.3])
    true = 2.0 * np.maximum(size - width, 0.0) ** exponent
    force = np.where(true > felt_n, true**law, 0.0)
    found = contact_point(width, force_n=force, give_mm=0 * width, floor_n=0.1)
    low, high = found.quantile([0.05, 0.95]).tolist()
    return low, high


@pytest.mark.parametrize("exponent", [1.0, 1.5])
@pytest.mark.parametrize("law", [0.8, 0.92, 1.05])
def test_a_law_whose_exponent_is_off_does_not_move_it_out(exponent: float, law: float) -> None:
    sizes = np.linspace(31.5, 32.5, 11)
    ends = [interval(s, exponent=exponent, law=law, felt_n=0.1) for s in sizes]
    inside = [low <= s <= high for s, (low, high) in zip(sizes, ends, strict=True)]
    assert np.mean(inside) >= 0.9


def test_a_place_that_feels_late_does_not_move_it_out() -> None:
    # About the weakest force that the calibration felt, and nothing felt here.
    size = 32.14
    assert 2.0 * (size - 32.0) ** 1.5 == pytest.approx(0.105, abs=0.001)
    low, high = interval(size, exponent=1.5, law=0.92, felt_n=0.2)
    assert low <= size <= high


def test_the_zero_of_the_gripper_is_never_sure() -> None:
    width = np.array([31.0, 30.5, 30.4, 30.3, 30.2, 30.1, 30.0])
    force = 200.0 * np.maximum(30.45 - width, 0.0)
    found = contact_point(width, force_n=force, give_mm=0 * width, floor_n=0.01)
    low, high = found.quantile([0.05, 0.95])
    # A block known to a tenth of a millimetre leaves a standard deviation of 0.06 mm.
    assert high - low >= 2 * 1.645 * 0.06 * 0.9
