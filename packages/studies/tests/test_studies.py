"""Every study of the twin at its smallest size, and what its figures must show."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.pdf_fonts import check_all_fonts

from palpate.object.damage_learning import FruitClosing
from palpate.plots.style import PAGE_WIDTH_IN
from palpate_studies import (
    detection_limit,
    environment,
    equal_width,
    fatigue,
    figure16,
    force_control,
    fruit_grip,
    grasp_cycle,
    harvest,
    noise,
    ripeness,
    ripeness_virtual,
    size,
    slip,
    speed,
    springs,
    staircases,
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
from palpate_studies.second.closings import other_closings

pytestmark = pytest.mark.slow

#: A unit in brackets, or a ratio that has none.
UNIT = re.compile(r"\((%|N|ohm|mm|kPa|mV)[^)]*\)|G/G₀")


@pytest.fixture(scope="module", autouse=True)
def small_studies() -> Iterator[None]:
    """Leave out the level `field`, where a study runs alike at both, and most repeats."""
    with pytest.MonkeyPatch.context() as patch:
        for module in (
            *(detection_limit, figure16, force_control, fruit_grip, grasp_cycle, noise, size),
            *(staircases, stiffness, table6),
        ):
            patch.setattr(module, "LEVELS", ("lab",))
        patch.setattr(force_control, "LEARNED_FROM", 4)
        patch.setattr(staircases, "LEARNED_FROM", 2)
        patch.setattr(equal_width, "SHOWN_GRASPS", 2)
        patch.setattr(stiffness, "REPEATED_N_PER_MM", (4.0,))
        patch.setattr(table5, "MATERIALS", table5.MATERIALS[:2])
        patch.setattr(ripeness_virtual, "LABELLED", 8)
        yield


@cache
def pulls() -> list[dict[str, Any]]:
    return harvest.judge_pulls(harvest.FIRST_SEED - 4, level="lab")


def renamed_closings() -> list[FruitClosing]:
    names = {"layered": "mango", "foam": "kiwi", "dough": "banana"}
    return [replace(one, fruit=names[one.fruit]) for one in other_closings()]


CHAINS = {
    name: noise.CHAINS[name]
    for name in ("250 Hz, no filter", "250 Hz, median of 5", "250 Hz, notch 50 and 60 Hz")
}
REPORTS: dict[str, Callable[[], StudyReport]] = {
    "table1": partial(table1.report, repeats=2),
    "table2": partial(table2.report, sensors=1, repeats=2),
    "table3": partial(table3.report, sensors=1, repeats=2, free_repeats=2),
    "springs": partial(springs.report, sensors=1, repeats=2),
    "table4": partial(table4.report, sensors=1, repeats=2),
    "table6": partial(table6.report, sensors=1, repeats=2),
    "figure16": partial(figure16.report, 1, grasps=2),
    "environment": partial(environment.report, sensors=1, repeats=2),
    "fatigue": partial(fatigue.report, sensors=1, cycles=20),
    "noise": partial(noise.report, sensors=1, chains=CHAINS),
    "detection-limit": partial(detection_limit.report, sensors=1),
    "slip": partial(slip.report, events=4, hours=0.1),
    "speed": partial(speed.report, sensors=1, repeats=1),
    "table5": partial(table5.report, sensors=1, repeats=1),
    "stiffness": partial(stiffness.report, grasps=1, repeats=2),
    "force-control": partial(force_control.report, grasps=1),
    "fruit-grip": lambda: fruit_grip.judge(fruit_grip.grip_all(renamed_closings(), every=81)),
    "grasp-cycle": partial(grasp_cycle.report, grasps=1),
    "staircases": partial(staircases.report, sheets=1, staircases=1),
    "size": partial(size.report, sensors=1, first_sensor=300, berries=2),
    "ripeness": partial(ripeness.report, sensors=1, fruits=4, second=True),
    "harvest": lambda: harvest.judge(pulls()),
}


@cache
def run(name: str) -> StudyReport:
    """Run each study once."""
    return REPORTS[name]()


def payload(name: str) -> dict[str, Any]:
    return run(name).document


def test_every_study_of_the_catalogue_has_a_command() -> None:
    for place, _ in (*STUDIES.values(), *BENCHMARKS.values()):
        assert callable(import_module(place).command)


@pytest.mark.parametrize("name", REPORTS)
def test_study_returns_plain_json_full_tables_and_figures_of_a_page(name: str) -> None:
    report = run(name)
    assert re.search("Simulated|Real", " ".join(report.provenance))
    assert json.loads(json.dumps(report.document, allow_nan=False))["study"] == name
    for table in report.tables:
        assert table.rows
        assert all(len(row) == len(table.columns) for row in table.rows)
    for draw in report.figures.values():
        figure = draw()
        figure.draw_without_rendering()
        assert figure.get_figwidth() <= PAGE_WIDTH_IN
        labels = [figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()]
        assert any(map(UNIT.search, labels)), labels


def test_write_creates_json_markdown_and_every_figure(tmp_path: Path) -> None:
    run("springs").write(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "springs.json",
        "springs.md",
        *(f"figure10b.{ending}" for ending in ("png", "svg", "pdf")),
    }
    check_all_fonts(tmp_path)


def test_table1_of_the_fitted_family_is_near_published_errors() -> None:
    def errors(method: str, mean: str) -> np.ndarray:
        rows = payload("table1")["families"]["two-mode"][method]
        return np.array([row[f"{mean}_abs_error_percent"] for row in rows])

    # With 40 holds of random relaxation, the standard error is about 4 % of each entry. The twin
    # also has effects that its fit did not have (relaxation of the pads, closing time).
    published = np.array(table1.PUBLISHED["recorded"])
    np.testing.assert_allclose(errors("recorded", "mean"), published, rtol=0.2, atol=0.1)
    # The published values are means. A short window does not determine C on some single holds,
    # which dominate the mean of 40: from 2 to 3 s the family misses the published values (3.4 on
    # ten sensors instead of 2.5, see docs/paper-notes.md). The medians are near everywhere.
    published = np.array(table1.PUBLISHED["exponential"])
    medians = errors("exponential", "median") / published
    assert np.all((medians > 0.7) & (medians < 1.5))
    means = errors("exponential", "mean") / published
    assert np.all((means > 0.6) & (means < np.where(np.arange(means.size) < 4, 1.8, 1.2)))


def test_slip_is_detected_without_alarms_in_quiet_holds() -> None:
    for row in payload("slip")["summary"]:
        assert row["seen"] == row["felt_before"]
        assert row["called_before"] == 0
    assert all(row["called"] == 0 for row in payload("slip")["quiet"])


def test_pull_beyond_friction_slips_and_is_not_secure() -> None:
    assert not any(one["slipped"] for one in pulls() if one["verdict"] == "secure to pull")
    slipped = [one["slipped"] for one in pulls()]
    assert slipped == sorted(slipped)
