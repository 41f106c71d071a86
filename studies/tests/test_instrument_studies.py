"""The studies of the instrument on the twin, at sizes that take seconds."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.pdf_fonts import check_fonts

from palpate.plots.style import PAGE_WIDTH_IN, letter_panels, save_figure
from palpate_studies import (
    detection_limit,
    environment,
    fatigue,
    noise,
    speed,
    springs,
    table2,
    table3,
    table4,
)
from palpate_studies.report import StudyReport
from palpate_studies.twin_session import Session, drawn

NOISE_CHAINS = ("250 Hz, no filter", "250 Hz, median of 5", "250 Hz, notch 50 and 60 Hz")
#: A unit in brackets, or a ratio that has none.
UNIT = re.compile(r"\((%|N|ohm|mm|kPa|mV)\)|G/G₀")
REPORTS: dict[str, Callable[[], StudyReport]] = {
    "table2": lambda: table2.report(sensors=1, repeats=2),
    "table3": lambda: table3.report(sensors=1, repeats=2, free_repeats=2),
    "springs": lambda: springs.report(sensors=1, repeats=2),
    "table4": lambda: table4.report(sensors=1, repeats=2),
    "environment": lambda: environment.report(sensors=1, repeats=2),
    "fatigue": lambda: fatigue.report(sensors=1, cycles=6, checked_at=(3,)),
    "noise": lambda: noise.report(
        sensors=1, chains={name: noise.CHAINS[name] for name in NOISE_CHAINS}
    ),
    "detection-limit": lambda: detection_limit.report(sensors=1),
    "speed": lambda: speed.report(sensors=1, repeats=1),
}


@pytest.fixture(scope="module")
def made() -> dict[str, StudyReport]:
    """Run each study once."""
    return {name: make() for name, make in REPORTS.items()}


@pytest.mark.parametrize("name", REPORTS)
def test_every_study_says_what_is_simulated_and_gives_plain_json(
    made: dict[str, StudyReport], name: str
) -> None:
    report = made[name]
    assert report.name == name
    assert "Simulated" in " ".join(report.provenance)
    assert report.payload["origin"] == "twin"
    assert json.loads(json.dumps(report.payload, allow_nan=False))["study"] == name
    for table in report.tables:
        assert table.rows
        assert all(len(row) == len(table.columns) for row in table.rows)


def test_a_study_is_written_with_its_figures(made: dict[str, StudyReport], tmp_path: Path) -> None:
    made["springs"].write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "springs.json",
        "springs.md",
        "figure10b.png",
        "figure10b.svg",
        "figure10b.pdf",
    }


@pytest.mark.parametrize("name", REPORTS)
def test_figures_fit_a_page_and_have_letters_units_and_editable_fonts(
    made: dict[str, StudyReport], name: str, tmp_path: Path
) -> None:
    assert made[name].figures
    for draw in made[name].figures.values():
        figure = draw()
        assert figure.get_figwidth() <= PAGE_WIDTH_IN
        letter_panels(figure)
        letters = [text.get_text() for axis in figure.axes for text in axis.texts]
        assert letters[: len(figure.axes)] == list("abcdef")[: len(figure.axes)] or not letters
        for axis in figure.axes:
            assert UNIT.search(axis.get_ylabel()), axis.get_ylabel()
        save_figure(figure, tmp_path / "figure.pdf")
        check_fonts(tmp_path / "figure.pdf")


def test_published_entries_stand_as_printed() -> None:
    assert table2.PUBLISHED["dragonskin-20"] == (-66.9, 0.52, "A-20")
    assert table3.PUBLISHED["ball-55lbs-b"] == (55, -62.8, 1.14)
    assert table4.PUBLISHED["ecoflex-10"] == (0.985, -0.0953, 0.987)
    assert (table3.STUDY.published_r_squared, springs.STUDY.published_r_squared) == (0.92, 0.96)


def test_stiffer_sheets_change_more_at_one_width(made: dict[str, StudyReport]) -> None:
    assert made["table2"].payload["sensors_in_order"]["lab"] == 1


def test_slopes_differ_by_their_force_range_not_by_the_sheet(
    made: dict[str, StudyReport],
) -> None:
    ratio = made["table4"].payload["slope_ratio"]["lab"]
    assert ratio["mean change, each sheet over its own forces"] > 1.4
    assert ratio["mean change, local slope at one force of all"] < 1.25
    assert ratio["summed excess: exponent of the power law, own forces"] < 1.25


def test_suction_raises_resistance(made: dict[str, StudyReport]) -> None:
    change = np.array(made["environment"].payload["suction_change_percent"]["lab"])
    assert np.all(np.diff(change, axis=1) > 0)


def test_spikes_fall_to_a_median_and_mains_to_a_notch(made: dict[str, StudyReport]) -> None:
    rms = {
        (row["chain"], row["disturbance"]): row["rms_points"]
        for row in made["noise"].payload["levels"]["lab"]
    }
    plain = "250 Hz, no filter"
    assert rms["250 Hz, median of 5", "motor spikes"] < 0.1 * rms[plain, "motor spikes"]
    assert rms["250 Hz, notch 50 and 60 Hz", "mains 60 Hz"] < 0.2 * rms[plain, "mains 60 Hz"]


def test_own_noise_sees_less_force_than_the_fixed_threshold(made: dict[str, StudyReport]) -> None:
    (fixed, own), *_ = made["detection-limit"].payload["weakest_n"]["lab, flat (springs)"]
    assert 0.0 < own < fixed < 5.0


def test_slow_closing_needs_the_clock_at_its_end(made: dict[str, StudyReport]) -> None:
    errors = {
        (row["speed_mm_per_s"], row["clock"]): row["median_abs_error_percent"]
        for row in made["speed"].payload["rows"]
        if (row["level"], row["method"]) == ("lab", "recorded")
    }
    assert errors[3.0, "start of actuation"] > 3 * errors[3.0, "end of actuation"]


def test_a_fixture_keeps_a_ball_near_the_middle() -> None:
    def shares(*, fixture: bool) -> list[float]:
        spread = []
        for trial in range(6):
            session, ball = Session(1, level="lab", trial=trial), drawn("ball-44lbs", seed=1)
            session.place(ball, fixture=fixture)
            reading = session.grasp(ball.size_mm, width_mm=ball.size_mm - 3.0, hold_s=3.0)
            spread.append(float(np.ptp(reading.change_percent)))
        return spread

    assert max(shares(fixture=True)) < 0.6 * max(shares(fixture=False))


def test_a_pixel_at_the_end_of_its_converter_reads_the_least_that_it_can_show() -> None:
    session = Session(
        1,
        level="field",
        remade=lambda sheet: replace(sheet, gain=1e4 * sheet.gain, saturation=1e6),
    )
    pad = drawn("dragonskin-30", seed=1)
    session.place(pad)
    reading = session.grasp(pad.size_mm, width_mm=pad.size_mm - 3.0, hold_s=1.0)
    least_ohm = session.world.layout.divider.least_ohm
    assert reading.ohm.min() == pytest.approx(least_ohm)
    assert np.isfinite(reading.excess)
