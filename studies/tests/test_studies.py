"""Requirements on all studies at small size, and on single studies."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.pdf_fonts import check_fonts

from palpate.plots.style import PAGE_WIDTH_IN, letter_panels, save_figure
from palpate_studies import (
    detection_limit,
    environment,
    fatigue,
    figure16,
    harvest,
    noise,
    ripeness,
    size,
    slip,
    speed,
    springs,
    stiffness,
    table1,
    table2,
    table3,
    table4,
    table5,
    table6,
)
from palpate_studies.catalogue import BENCHMARKS, STUDIES
from palpate_studies.report import StudyReport
from palpate_studies.twin_session import Session, draw_named

pytestmark = pytest.mark.slow

NOISE_CHAINS = ("250 Hz, no filter", "250 Hz, median of 5", "250 Hz, notch 50 and 60 Hz")
#: A unit in brackets, or a ratio that has none.
UNIT = re.compile(r"\((%|N|ohm|mm|kPa|mV)[^)]*\)|G/G₀")
REPORTS: dict[str, Callable[[], StudyReport]] = {
    "table1": lambda: table1.report(repeats=2),
    "table2": lambda: table2.report(sensors=1, repeats=2),
    "table3": lambda: table3.report(sensors=1, repeats=2, free_repeats=2),
    "springs": lambda: springs.report(sensors=1, repeats=2),
    "table4": lambda: table4.report(sensors=1, repeats=2),
    "table6": lambda: table6.report(sensors=1, repeats=2),
    "figure16": lambda: figure16.report(1, grasps=2),
    "environment": lambda: environment.report(sensors=1, repeats=2),
    "fatigue": lambda: fatigue.report(sensors=1, cycles=40),
    "noise": lambda: noise.report(
        sensors=1, chains={name: noise.CHAINS[name] for name in NOISE_CHAINS}
    ),
    "detection-limit": lambda: detection_limit.report(sensors=1),
    "slip": lambda: slip.report(events=4, hours=0.1),
    "speed": lambda: speed.report(sensors=1, repeats=1),
    "table5": lambda: table5.report(sensors=1, repeats=1),
    "stiffness": lambda: stiffness.report(grasps=4, repeats=3),
    "size": lambda: size.report(sensors=1, first_sensor=300, berries=2),
    "ripeness": lambda: ripeness.report(sensors=1, fruits=4, second=True),
    "harvest": lambda: harvest.judge(harvest.judge_pulls(harvest.FIRST_SEED - 4, level="lab")),
}


@cache
def run(name: str) -> StudyReport:
    """Run each study once."""
    return REPORTS[name]()


def payload(name: str) -> dict[str, Any]:
    return run(name).document


@pytest.mark.parametrize("place", [place for place, _ in (*STUDIES.values(), *BENCHMARKS.values())])
def test_catalogue_command_has_help_with_example(place: str) -> None:
    command = import_module(place).command
    assert "Example: palpate " in (command.__doc__ or "")
    assert {"as_json", "out"} & set(inspect.signature(command).parameters)


@pytest.mark.parametrize("name", REPORTS)
def test_study_states_its_origin_and_returns_plain_json(name: str) -> None:
    report = run(name)
    assert report.name == name
    assert re.search("Simulated|Real", " ".join(report.provenance))
    assert json.loads(json.dumps(report.document, allow_nan=False))["study"] == name
    for table in report.tables:
        assert table.rows
        assert all(len(row) == len(table.columns) for row in table.rows)


@pytest.mark.parametrize("name", REPORTS)
def test_figure_fits_a_page_and_has_letters_units_and_editable_fonts(
    name: str, tmp_path: Path
) -> None:
    for draw in run(name).figures.values():
        figure = draw()
        assert figure.get_figwidth() <= PAGE_WIDTH_IN
        letter_panels(figure)
        letters = [text.get_text() for axis in figure.axes for text in axis.texts]
        assert letters[: len(figure.axes)] == list("abcdef")[: len(figure.axes)] or not letters
        labels = [figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()]
        assert any(map(UNIT.search, labels)), labels
        save_figure(figure, tmp_path / "figure.pdf")
        check_fonts(tmp_path / "figure.pdf")


def test_write_creates_json_markdown_and_every_figure(tmp_path: Path) -> None:
    run("springs").write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "springs.json",
        "springs.md",
        *(f"figure10b.{ending}" for ending in ("png", "svg", "pdf")),
    }


def test_published_entries_match_the_paper() -> None:
    assert table2.PUBLISHED["dragonskin-20"] == (-66.9, 0.52, "A-20")
    assert table3.PUBLISHED["ball-55lbs-b"] == (55, -62.8, 1.14)
    assert table4.PUBLISHED["ecoflex-10"] == (0.985, -0.0953, 0.987)
    assert (table3.STUDY.published_r_squared, springs.STUDY.published_r_squared) == (0.92, 0.96)
    for variant in ("free", "supported"):
        entries = payload("table6")["met"][variant]["lab"]
        assert len(entries) == 6
        assert entries["recorded, 20 s, before"]["published"] == -21.2


def test_table2_stiffer_sheet_changes_more_at_one_width() -> None:
    assert payload("table2")["sensors_in_order"]["lab"] == 1


def test_environment_suction_raises_resistance() -> None:
    change = np.array(payload("environment")["suction_change_percent"]["lab"])
    assert np.all(np.diff(change, axis=1) > 0)


def test_noise_median_removes_spikes_and_notch_removes_mains() -> None:
    rms = {
        (row["chain"], row["disturbance"]): row["rms_points"]
        for row in payload("noise")["levels"]["lab"]
    }
    plain = "250 Hz, no filter"
    assert rms["250 Hz, median of 5", "motor spikes"] < 0.1 * rms[plain, "motor spikes"]
    assert rms["250 Hz, notch 50 and 60 Hz", "mains 60 Hz"] < 0.2 * rms[plain, "mains 60 Hz"]


def test_detection_limit_of_own_noise_is_below_fixed_threshold() -> None:
    (fixed, own), *_ = payload("detection-limit")["weakest_n"]["lab, flat (springs)"]
    assert 0.0 < own < fixed < 5.0


def test_speed_slow_closing_requires_clock_at_end_of_actuation() -> None:
    errors = {
        (row["speed_mm_per_s"], row["clock"]): row["median_abs_error_percent"]
        for row in payload("speed")["rows"]
        if (row["level"], row["method"]) == ("lab", "recorded")
    }
    assert errors[3.0, "start of actuation"] > 3 * errors[3.0, "end of actuation"]


def test_slip_is_detected_without_alarms_in_quiet_holds() -> None:
    for row in payload("slip")["summary"]:
        assert row["seen"] == row["felt_before"]
        assert row["called_before"] == 0
    assert all(row["called"] == 0 for row in payload("slip")["quiet"])


def test_fatigue_true_force_is_constant_over_cycles() -> None:
    for level in ("lab", "field"):
        true_n = np.array(payload("fatigue")["levels"][level][0]["true_n"])
        assert np.ptp(true_n) < 0.1 * true_n.mean()


def test_figure16_rigid_fingers_show_published_trend() -> None:
    rows = payload("figure16")["summary"]
    assert len(rows) == 6
    assert all(len(row["mean_percent"]) == figure16.DAYS for row in rows)
    found = {row["hand"]: row["mean_percent"] for row in rows if row["level"] == "lab"}
    assert found["rigid, one width"][-1] > found["rigid, one width"][0] + 5.0


def test_session_fixture_reduces_spread_of_pixels() -> None:
    def pixel_ranges(*, fixture: bool) -> list[float]:
        spread = []
        for trial in range(6):
            session, ball = Session(1, level="lab", trial=trial), draw_named("ball-44lbs")
            session.place(ball, fixture=fixture)
            reading = session.grasp(ball.size_mm, width_mm=ball.size_mm - 3.0, hold_s=3.0)
            spread.append(float(np.ptp(reading.change_percent)))
        return spread

    assert max(pixel_ranges(fixture=True)) < 0.6 * max(pixel_ranges(fixture=False))


def test_session_saturated_pixel_reads_smallest_resistance() -> None:
    session = Session(
        1,
        level="field",
        replace_sheet=lambda sheet: replace(sheet, gain=1e4 * sheet.gain, saturation=1e6),
    )
    pad = draw_named("dragonskin-30")
    session.place(pad)
    reading = session.grasp(pad.size_mm, width_mm=pad.size_mm - 3.0, hold_s=1.0)
    least_ohm = session.world.layout.divider.least_ohm
    assert reading.ohm.min() == pytest.approx(least_ohm)
    assert np.isfinite(reading.excess)
