"""Studies of size, slip and the hybrid: small runs, and scores of known errors."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.pdf_fonts import check_all_fonts

from palpate.estimate.damage_learning import read_closings
from palpate.estimate.measurement import Measurement
from palpate_studies import hybrid, size, slip
from palpate_studies.baselines.told_everything import LEARNERS
from palpate_studies.hybrid_data import read_curves, read_sheets
from palpate_studies.hybrid_grasps import fixed_closing
from palpate_studies.hybrid_world import Curve, Lag, RecordedSheet, RecordedWorld
from palpate_studies.size_grasps import Sized, deeper_mm, errors_mm, sized


def said(value: float, half: float = 0.3) -> Measurement:
    return Measurement(value=value, low=value - half, high=value + half, unit="mm")


def test_scores_of_sizes() -> None:
    berries = [
        Sized(
            sensor=0,
            berry=number,
            true_mm=35.0,
            published_mm=published,
            same_steps=None,
            ours=said(ours),
            damaged=False,
            damaged_by_same_steps=number == 0,
            pressed_to_mm=33.5,
            steps=np.zeros(3),
        )
        for number, (published, ours) in enumerate([(36.0, 35.1), (34.0, 35.5), (35.0, 34.9)])
    ]
    published, ours = size.scores(berries, "published"), size.scores(berries, "ours")
    assert published["rms_mm"] == pytest.approx(np.sqrt(2 / 3))
    assert published["within_1_mm"] == 1.0
    assert ours["coverage"] == pytest.approx(2 / 3)
    assert ours["worst_mm"] == pytest.approx(0.5)
    assert size.scores(berries, "same_steps")["rms_mm"] is None
    assert size.scores(berries, "same_steps")["damaged"] == 1
    # Contact was seen at 35, 33 and 34 mm, a step within the answers.
    assert deeper_mm(berries) == pytest.approx(0.5)
    # One sensor alone: there is no other to learn on.
    assert size.scores(berries, "ridge")["answered"] == 0


def test_size_study_is_finite_and_says_simulated(tmp_path: Path) -> None:
    report = size.report(sensors=1, first_sensor=300, berries=2)
    report.write(tmp_path)
    stored = json.loads((tmp_path / "size.json").read_text())
    assert stored["origin"] == "twin"
    assert [row["strawberries"] for row in stored["summary"]] == [2] * 2 * len(size.WAYS)
    ours = [row for row in stored["summary"] if row["way"] == "ours"]
    assert all(row["rms_mm"] < 1.0 for row in ours)
    assert "Simulated" in (tmp_path / "size.md").read_text()
    assert (tmp_path / "figure14.png").stat().st_size > 10_000
    check_all_fonts(tmp_path)


def test_learners_of_the_size_see_all_that_ours_read_and_no_fruit_of_the_same_sensor() -> None:
    berries = list(sized("lab", sensors=range(300, 303), berries=3))
    for learner in LEARNERS:
        errors = errors_mm(berries, learner)
        assert np.sqrt(np.mean(errors**2)) < 1.5
        # What a sensor shows of its own fruit changes nothing in its answers.
        other = [
            replace(one, true_mm=one.true_mm + 5.0) if one.sensor == 300 else one for one in berries
        ]
        moved = errors_mm(other, learner) - errors
        np.testing.assert_allclose(moved[:3], -5.0)
        assert np.abs(moved[3:]).max() > 0.01
    widths = [one.steps[1:].reshape(-1, 9)[:, 0] for one in berries]
    assert all(one[-1] == 0.0 and one.min() == 0.0 and one[0] > 0.5 for one in widths)


def test_slip_study_sees_and_stays_quiet(tmp_path: Path) -> None:
    report = slip.report(events=4, hours=0.1, first_sensor=900)
    report.write(tmp_path)
    for row in report.payload["summary"]:
        assert row["seen"] == row["felt_before"]
        assert row["called_before"] == 0
    for row in report.payload["quiet"]:
        assert row["called"] == 0
    assert (tmp_path / "slip.png").stat().st_size > 10_000
    check_all_fonts(tmp_path)


# -- the hybrid ------------------------------------------------------------------------------------

CURVE = Curve(
    name="a",
    fruit="kiwi",
    closing_mm=np.array([0.0, 1.0, 2.0]),
    force_n=np.array([0.0, 1.0, 4.0]),
    rupture_n=4.0,
)
SHEET = RecordedSheet(
    rest_ohm=800.0,
    load_n=np.array([0.0, 0.5, 1.0, 2.0, 10.0]),
    log_fall=np.array([0.0, 1.0, 1.5, 2.0, 4.0]),
    scatter=0.0,
    lags=[Lag(since_s=np.array([0.0, 20.0]), share=np.array([0.9, 1.0]))],
)


def test_the_recorded_world_plays_the_recordings() -> None:
    from palpate.sensor.array import RIGID_LAYOUT

    world = RecordedWorld(SHEET, layout=RIGID_LAYOUT, seed=1)
    world.place(CURVE, size_mm=40.0)
    world.drive(39.0, rate=60.0)
    world.clock.sleep_s(30.0)
    now_s = world.now_s()
    assert world.force_n(now_s) == pytest.approx(1.0)
    ohm = world.pixel_resistance_ohm(now_s)
    # A finger's newton is shared among its four pixels, and each answers by the ladder.
    loads = np.interp(np.log(800.0 / ohm), SHEET.log_fall, SHEET.load_n)
    np.testing.assert_allclose(loads.reshape(2, 4).sum(axis=1), 1.0, rtol=1e-3)
    assert world.peak_force_n == pytest.approx(1.0)


def test_a_step_is_answered_like_a_hold() -> None:
    from palpate.sensor.array import RIGID_LAYOUT

    world = RecordedWorld(SHEET, layout=RIGID_LAYOUT, seed=1)
    world.place(CURVE, size_mm=40.0)
    world.drive(39.0, rate=1e3)
    world.clock.sleep_s(0.1)
    early = np.log(800.0 / world.pixel_resistance_ohm(world.now_s()))
    world.clock.sleep_s(30.0)
    late = np.log(800.0 / world.pixel_resistance_ohm(world.now_s()))
    np.testing.assert_allclose(early / late, 0.9, atol=0.005)


def test_a_fixed_closing_ruptures_what_is_soft() -> None:
    assert fixed_closing(CURVE, contact_n=0.2).damaged


def test_hybrid_on_the_recordings(real_data: Path, tmp_path: Path) -> None:
    curves, index = real_data / "fruit_rupture.csv.gz", real_data / "fruit_rupture_index.csv"
    read = read_curves(curves, index)
    assert len(read) == 163
    assert all(curve.force_n[-1] >= curve.rupture_n for curve in read)
    sheets = read_sheets(
        real_data / "velostat_force_ladders.csv", [real_data / "holds_velostat.csv.gz"]
    )
    report = hybrid.report(read, read_closings(curves, index), sheets, grasps=2, firmware=False)
    report.write(tmp_path)
    ways = {row["way"]: row for row in report.payload["rows"][:4]}
    ours, told = ways[hybrid.OURS], ways[hybrid.TOLD]
    assert ours["peak_n"] < ways["threshold and 3 mm"]["peak_n"]
    assert not ours["damaged"]
    assert not told["damaged"]
    assert (tmp_path / "hybrid.png").stat().st_size > 10_000
    check_all_fonts(tmp_path)
