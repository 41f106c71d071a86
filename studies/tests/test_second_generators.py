"""Second generators differ from the first in the intended properties."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.velostat import FAMILIES, draw_sheet
from palpate_studies.grasp_cycle import Sample
from palpate_studies.second.fruit import COURSES, other_avocado
from palpate_studies.second.sheets import other_sheet
from palpate_studies.twin_avocado import draw_avocado


@pytest.mark.parametrize("course", COURSES)
def test_other_avocado_softens_between_same_limits(course: str) -> None:
    fruit = draw_avocado(np.random.default_rng(4))
    other = other_avocado(fruit, course=course)
    forces_n = [other.force_at_1mm_n(day) for day in np.arange(-12.0, 25.0, 0.1)]
    assert forces_n[0] == pytest.approx(fruit.hard_n)
    assert forces_n[-1] == pytest.approx(fruit.softest_n, rel=0.01)
    assert np.all(np.diff(forces_n) <= 1e-12)
    at = np.arange(-2.0, 6.0)
    first = np.log([fruit.force_at_1mm_n(day) for day in at])
    assert np.max(np.abs(first - np.log([other.force_at_1mm_n(day) for day in at]))) > 0.2


@pytest.mark.parametrize("level", ["lab", "field"])
def test_coordinate_of_creep_returns_to_its_excess_conductance(level: str) -> None:
    """In every family, of both generators."""
    drawn = [
        draw_sheet(np.random.default_rng(seed), layout=RIGID_LAYOUT, level=level).family
        for seed in range(30)
    ]
    assert {family.name for family in drawn} == set(FAMILIES)
    sheet = draw_sheet(np.random.default_rng(0), layout=RIGID_LAYOUT, level=level)
    excess = np.geomspace(1e-4, 300.0, 50)
    for family in (*drawn, other_sheet(sheet).family):
        assert family.excess_conductance(family.coordinate(excess)) == pytest.approx(excess)


def test_other_sheet_follows_no_power_law() -> None:
    sheet = other_sheet(draw_sheet(np.random.default_rng(3), layout=RIGID_LAYOUT, level="lab"))
    load_n = np.geomspace(0.02, 20.0, 40)
    slope = np.gradient(np.log(sheet.static_excess(load_n, gain=np.ones(40))), np.log(load_n))
    assert slope[0] == pytest.approx(1.8, abs=0.05)
    assert slope[-1] < 0.5
    assert np.all(np.diff(slope) < 1e-6)


def test_other_objects_keep_their_size_and_get_another_curve() -> None:
    for seed, name in ((960_000, "layered"), (960_001, "foam"), (960_002, "dough")):
        first, second = (
            Sample(seed=seed, level="lab", kind="rigid", second=other).obj()
            for other in (False, True)
        )
        assert (second.name, second.size_mm) == (name, first.size_mm)
