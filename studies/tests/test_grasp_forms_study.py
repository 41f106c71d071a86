"""Things of other forms: their curves, and the study that grasps them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from palpate.estimate.damage_learning import read_closings
from palpate.twin.mechanics import object_force_n
from palpate.twin.objects import TwinObject
from palpate_studies.force_control_world import thing
from palpate_studies.grasp_forms import report
from palpate_studies.other_things import curve_of, dough, foam, layered, long_enough, recorded


@pytest.fixture
def drawn() -> TwinObject:
    return thing(np.random.default_rng(5), size_mm=(40.0, 41.0))


def forces_n(obj: TwinObject, at_mm: list[float]) -> list[float]:
    return [object_force_n(obj, mm, ruptured=False)[0] for mm in at_mm]


def test_a_skin_gives_way_to_softer_flesh_and_a_core(drawn: TwinObject) -> None:
    made = layered(drawn)
    skin, flesh, core = np.diff(
        [forces_n(made, [mm, mm + 0.1]) for mm in (0.1, 1.0, 5.0)], axis=1
    ).ravel()
    assert skin == pytest.approx(3 * flesh)
    if made.yield_n > forces_n(made, [5.1])[0]:
        assert core == pytest.approx(6 * flesh)


def test_other_forms_yield_at_the_same_deformation(drawn: TwinObject) -> None:
    yields_mm = (drawn.yield_n / drawn.force_at_1mm_n) ** (1 / drawn.exponent)
    for made in (layered(drawn), foam(drawn)):
        below_n, above_n = forces_n(made, [yields_mm - 1e-6, yields_mm + 1e-6])
        assert below_n < made.yield_n < above_n
        before, after = (
            object_force_n(made, yields_mm + by, ruptured=False)[1] for by in (-1e-6, 1e-6)
        )
        assert after == pytest.approx(0.3 * before)


def test_foam_stiffens_faster_than_a_contact(drawn: TwinObject) -> None:
    one, two = forces_n(foam(drawn), [1.0, 2.0])
    assert two == pytest.approx(2**2.5 * one, rel=0.02)


def test_dough_loses_half_of_its_force(drawn: TwinObject) -> None:
    assert sum(dough(drawn).relaxing_share) == pytest.approx(0.5)


def test_recorded_curves_rise_from_zero_to_rupture(drawn: TwinObject, real_data: Path) -> None:
    closings = long_enough(
        read_closings(real_data / "fruit_rupture.csv.gz", real_data / "fruit_rupture_index.csv")
    )
    assert len(closings) > 150
    for closing in closings:
        at_mm, force_n = np.array(curve_of(closing)).T
        assert (at_mm[0], force_n[0]) == (0.0, 0.0)
        assert (np.diff(at_mm) > 0).all()
        assert (np.diff(force_n) > 0).all()
        assert 0.9 * closing.rupture_force_n - 0.3 < force_n[-1] <= closing.rupture_force_n
    made = recorded(drawn, closings[0])
    at_mm, force_n = np.array(made.curve).T
    assert forces_n(made, at_mm.tolist()) == pytest.approx(force_n.tolist())


def test_every_form_is_grasped_on_every_hand(real_data: Path) -> None:
    fruit = read_closings(real_data / "fruit_rupture.csv.gz", real_data / "fruit_rupture_index.csv")
    found = report(1, fruit=fruit[:1], first_seed=31_100)
    rows = found.payload["summary"]
    assert len(rows) == 2 * 2 * 5
    assert {row["way"] for row in rows} == {"as drawn", "layered", "foam", "dough", "real fruit"}
    assert all(row["grasps"] == 1 for row in rows)
    assert len(found.tables[0].rows) == len(rows)
