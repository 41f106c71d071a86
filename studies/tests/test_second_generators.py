"""Second generators differ from the first in the intended properties."""

from __future__ import annotations

import numpy as np
import pytest

from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.crate import draw_crate
from palpate.twin.sheet_state import SheetState
from palpate.twin.velostat import draw_sheet
from palpate.twin.world import World
from palpate_studies import ripeness
from palpate_studies.fruit_ranges import BRUISES
from palpate_studies.grasp_cycle import Sample
from palpate_studies.second.fruit import COURSES, CorkyPatch, corky, other_avocado
from palpate_studies.second.objects import other_item
from palpate_studies.second.sheets import OtherSheet, other_sheet
from palpate_studies.twin_apple import draw_apple
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


def test_corky_bruise_has_core_and_rim_and_keeps_sound_apple() -> None:
    rng = np.random.default_rng(2)
    bruised = draw_apple(rng, bruises=BRUISES)
    assert bruised.bruise is not None
    face = corky(bruised).facing(bruised.bruise.angle_deg).faces.faces[0]
    assert isinstance(face.patch, CorkyPatch)
    line = np.linspace(0, 0.99, 100) * face.patch.radius_mm
    profile = face.patch.profile(line + face.patch.along_mm, np.array([face.patch.across_mm]))
    assert profile[0] == 0.5
    assert profile[70] == 1.0
    assert profile[-1] < 0.1
    sound = draw_apple(rng, bruises=None)
    assert corky(sound).facing(30.0).size_mm == sound.facing(30.0).size_mm


@pytest.mark.slow
def test_ripeness_second_generator_pairs_methods_by_fruit() -> None:
    payload = ripeness.report(sensors=1, fruits=4, second=True).payload
    assert payload["simulated"] is True
    assert [row["generator"] for row in payload["ripeness"]] == ["first", *COURSES, "all three"]
    for row in payload["ripeness"]:
        assert row["fruit_days"] == row["wrong_less_learned"]["trees"]["cases"] == 16
        assert row["wrong_less_learned"]["trees"]["specimens"] == 4
        for learner, exact in row["exact_learned"].items():
            less = row["wrong_less_learned"][learner]["difference"]
            assert less == pytest.approx(exact - row["exact"])


def other() -> OtherSheet:
    return other_sheet(draw_sheet(np.random.default_rng(3), layout=RIGID_LAYOUT, level="lab"))


def test_other_sheet_follows_no_power_law() -> None:
    sheet = other()
    load_n = np.geomspace(0.02, 20.0, 40)
    slope = np.gradient(np.log(sheet.static_excess(load_n, gain=np.ones(40))), np.log(load_n))
    assert slope[0] == pytest.approx(1.8, abs=0.05)
    assert slope[-1] < 0.5
    assert np.all(np.diff(slope) < 1e-6)


def test_other_sheet_has_fixed_hysteresis_and_constant_creep_rate() -> None:
    sheet = other()
    play_n = sheet.follow(np.array([4.0, 9.0]), np.array([2.0, 7.0])) - [2.0, 7.0]
    assert play_n[0] == pytest.approx(play_n[1])
    assert 0 < play_n[0] < 2
    creep = sheet.family.draw(np.random.default_rng(1))
    state = SheetState.at_rest(8, creep=creep)
    ohm = [sheet.rest_ohm.mean()]
    for _ in range(400):
        state = state.advance(
            0.1, np.full(8, 2.0), travel_mm=0.0, sheet=sheet, gain=sheet.gain, creep=creep
        )
        ohm.append(state.resistance_ohm(sheet, creep=creep).mean())
    falling = -np.diff(np.log(ohm))
    assert falling[20] > 5 * falling[150]
    assert falling[390] == pytest.approx(falling[150], rel=0.2)


def test_world_with_replace_sheet_uses_other_sheet() -> None:
    first, second = World(None, seed=5), World(None, seed=5, replace_sheet=other_sheet)
    assert isinstance(second.sheet, OtherSheet)
    assert second.sheet.rest_ohm.tolist() == first.sheet.rest_ohm.tolist()


def test_second_generator_objects_keep_size_and_change_curve() -> None:
    for seed, name in ((960_000, "layered"), (960_001, "foam"), (960_002, "dough")):
        first, second = (
            Sample(seed=seed, level="lab", kind="rigid", second=other).obj()
            for other in (False, True)
        )
        assert second.name == name
        assert second.size_mm == first.size_mm


def test_other_item_has_skin_unless_shell() -> None:
    kiwi, egg = map(other_item, draw_crate(["kiwi", "egg"], seed=4))
    assert kiwi.side(0).curve is not None
    assert egg.side(0).curve is None
