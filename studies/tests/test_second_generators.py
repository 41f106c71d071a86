"""Fruit of the second generator differs from the first, and its study says what falls."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from palpate.cli import build_app
from palpate_studies.bruise_data import as_drawn
from palpate_studies.fruit_ranges import BRUISES
from palpate_studies.other_fruit import WAYS, CorkyPatch, corky, other_avocado
from palpate_studies.twin_apple import draw_apple
from palpate_studies.twin_avocado import draw_avocado


@pytest.mark.parametrize("way", WAYS)
def test_other_avocados_soften_from_the_same_start_to_the_same_end(way: str) -> None:
    fruit = draw_avocado(np.random.default_rng(4))
    other = other_avocado(fruit, way=way)
    course = [other.force_at_1mm_n(day) for day in np.arange(-12.0, 25.0, 0.1)]
    assert course[0] == pytest.approx(fruit.hard_n)
    assert course[-1] == pytest.approx(fruit.softest_n, rel=0.01)
    assert np.all(np.diff(course) <= 1e-12)
    at = np.arange(-2.0, 6.0)
    first = np.log([fruit.force_at_1mm_n(day) for day in at])
    assert np.max(np.abs(first - np.log([other.force_at_1mm_n(day) for day in at]))) > 0.2


def test_a_corky_bruise_has_a_core_and_a_rim_and_a_sound_apple_stays_as_it_is() -> None:
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
    assert as_drawn(sound) is sound


def test_the_study_pairs_ours_with_that_day_alone(tmp_path: Path) -> None:
    arguments = ["--sensors", "1", "--fruits", "4", "--apple-sensors", "0", "--out", str(tmp_path)]
    found = CliRunner().invoke(build_app(), ["study", "second-generators", *arguments, "--json"])
    assert found.exit_code == 0
    document = json.loads((tmp_path / "second-generators.json").read_text())
    assert document["simulated"] is True
    assert [row["generator"] for row in document["ripeness"]] == ["first", *WAYS, "all three"]
    for row in document["ripeness"]:
        assert row["fruit_days"] == row["wrong_less_one_day"]["cases"] == 16
        assert row["wrong_less_one_day"]["specimens"] == 4
