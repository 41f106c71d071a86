"""The size study: small runs, and scores of known errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.pdf_fonts import check_all_fonts

from palpate.estimate.measurement import Measurement
from palpate_studies import size
from palpate_studies.size import SizedStrawberry, errors_mm, measure_sizes


def measured(value: float, half: float = 0.3) -> Measurement:
    return Measurement(value=value, low=value - half, high=value + half, unit="mm")


def test_size_scores_of_known_errors_are_exact() -> None:
    berries = [
        SizedStrawberry(
            sensor=0,
            true_mm=35.0,
            published_mm=published,
            same_steps=measured(ours),
            damaged=number == 0,
            pressed_to_mm=33.5,
            steps=np.zeros(3),
        )
        for number, (published, ours) in enumerate([(36.0, 35.1), (34.0, 35.5), (35.0, 34.9)])
    ]
    published, ours = size.scores(berries, "published"), size.scores(berries, "same_steps")
    assert published["rms_mm"] == pytest.approx(np.sqrt(2 / 3))
    assert published["within_1_mm"] == 1.0
    assert ours["coverage"] == pytest.approx(2 / 3)
    assert ours["worst_mm"] == pytest.approx(0.5)
    assert ours["damaged"] == 1
    # With one sensor there is no training set.
    assert size.scores(berries, "trees")["answered"] == 0


@pytest.mark.slow
def test_size_study_is_finite_and_states_simulated(tmp_path: Path) -> None:
    report = size.report(sensors=1, first_sensor=300, berries=2)
    report.write(tmp_path)
    stored = json.loads((tmp_path / "size.json").read_text())
    assert stored["origin"] == "twin"
    assert [row["strawberries"] for row in stored["summary"]] == [2] * 2 * len(size.METHODS)
    ours = [row for row in stored["summary"] if row["way"] == "same_steps"]
    assert all(row["rms_mm"] < 1.0 for row in ours)
    assert "Simulated" in (tmp_path / "size.md").read_text()
    assert (tmp_path / "figure14.png").stat().st_size > 10_000
    check_all_fonts(tmp_path)


@pytest.mark.slow
def test_size_trees_are_trained_on_other_sensors_only() -> None:
    berries = list(measure_sizes("lab", sensors=range(300, 303), berries=3))
    errors = errors_mm(berries, "trees")
    assert np.sqrt(np.mean(errors**2)) < 1.5
    # The true sizes of a sensor's own fruit do not affect its predictions.
    other = [
        replace(one, true_mm=one.true_mm + 5.0) if one.sensor == 300 else one for one in berries
    ]
    moved = errors_mm(other, "trees") - errors
    np.testing.assert_allclose(moved[:3], -5.0)
    assert np.abs(moved[3:]).max() > 0.01
    widths = [one.steps[1:].reshape(-1, 9)[:, 0] for one in berries]
    assert all(one[-1] == 0.0 and one.min() == 0.0 and one[0] > 0.5 for one in widths)
