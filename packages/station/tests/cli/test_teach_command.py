"""`palpate teach` and `palpate qualify`: labels and readings from a table or the store."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from packages.station.tests.cli.stored import stored_grasp
from packages.station.tests.factories import NOON
from tests.commands import Command

from palpate.measurement import Measurement, Status
from palpate_station.records import About, Item, Source, Verdict
from palpate_station.store import Store


def write_table(path: Path, *, unlabelled: int = 2) -> Path:
    random = np.random.default_rng(2)
    lines = ["item_id,label,firmness,size_mm"]
    for item in range(24):
        firmness = random.normal(30.0 + 30.0 * (item % 2), 4.0)
        label = "" if item < unlabelled else ("soft", "firm")[item % 2]
        lines.append(f"A{item},{label},{firmness:.1f},{random.normal(60.0, 2.0):.1f}")
    path.write_text("\n".join(lines) + "\n")
    return path


VALUES = {"size_mm": 60.0, "settled_percent": -40.0, "force_n": 5.0}


@pytest.fixture
def store(tmp_path: Path) -> Path:
    """Return a store of twenty avocados, alternately soft and firm, without grade labels."""
    path, random = tmp_path / "store.sqlite", np.random.default_rng(3)
    with Store.open(path) as opened:
        for number in range(20):
            name, is_firm = f"A{number}", number % 2
            opened.add_item(Item(item_id=name, kind="avocado"))
            firmness = float(random.normal(30 + 30 * is_firm, 3))
            load = tuple(random.normal((-60, -40 - 15 * is_firm, -50, -50), 1.0).tolist())
            firm = {"firmness": firmness, "stiffness_n_per_mm": firmness / 10}
            pixels = (load[:2], load[2:]) * 2
            given = {"rig": "test", "origin": "hardware", "pixel_settled_percent": pixels}
            opened.add_grasp(stored_grasp(name, VALUES | firm, half=0.1, **given))
            person = {"item_id": name, "given_at": NOON, "source": Source.PERSON}
            ripeness, bruise = (("ripe", "bruised"), ("hard", "sound"))[is_firm]
            opened.add_verdict(Verdict(about=About.RIPENESS, text=ripeness, **person))
            opened.add_verdict(Verdict(about=About.BRUISE, text=bruise, **person))
    return path


def test_teach_table_reports_accuracy_and_labels_unlabelled_rows(
    tmp_path: Path, palpate: Command
) -> None:
    file = write_table(tmp_path / "grades.csv")
    document = palpate("teach", "grade", "--table", file, "--json").document
    assert document["features"] == ["firmness", "size_mm"]
    assert document["items"] == 22
    assert document["right"] > 0.9 > 0.6 > document["right_by_chance"]
    assert [(one["item_id"], one["label"]) for one in document["named"]] == [
        ("A0", "soft"),
        ("A1", "firm"),
    ]
    assert "22 labelled items" in palpate("teach", "grade", "--table", file).out


def test_teach_grade_stores_given_labels_before_learning(store: Path, palpate: Command) -> None:
    labels = [f"--say=A{number}={('II', 'I')[number % 2]}" for number in range(12)]
    document = palpate(
        "teach", "grade", "--kind", "avocado", *labels, "--store", store, "--json"
    ).document
    assert document["items"] == 12
    assert document["right"] == 1.0
    assert {one["item_id"]: one["label"] for one in document["named"]} == {
        f"A{number}": ("II", "I")[number % 2] for number in range(12, 20)
    }
    with Store.open(store) as opened:
        assert len(opened.verdicts(About.BIN, source=Source.PERSON)) == 12


@pytest.mark.parametrize(("question", "features"), [("ripeness", 1), ("bruise", 17)])
def test_teach_learns_each_question_from_the_store(
    store: Path, palpate: Command, question: str, features: int
) -> None:
    document = palpate("teach", question, "--kind", "avocado", "--store", store, "--json").document
    assert len(document["features"]) == features
    assert document["items"] == 20
    assert document["right"] > 0.9
    assert document["named"] == []


def test_teach_uses_bounds_and_names_the_items_that_it_leaves_out(
    store: Path, palpate: Command
) -> None:
    bound = Measurement(value=None, low=1.6, high=9.0, unit="n_per_mm", status=Status.AT_LEAST)
    with Store.open(store) as opened:
        for name, known in (("B1", {"stiffness_n_per_mm": bound}), ("B2", {})):
            grasp = stored_grasp(name, VALUES | {"firmness": 30.0})
            opened.add_grasp(replace(grasp, measurements={**grasp.measurements, **known}))
    labels = [f"--say=A{number}={('II', 'I')[number % 2]}" for number in range(6)]
    labels += ["--say=B1=II", "--say=B2=II"]
    shown = palpate("teach", "grade", *labels, "--store", store, "--json")
    assert shown.document["items"] == 7
    assert shown.document["left_out"] == {"B2": "stiffness_n_per_mm"}
    assert "left out: 1 " in shown.err
    assert "B2 (stiffness_n_per_mm)" in shown.err


def write_readings(path: Path, *, items: int = 40) -> Path:
    random = np.random.default_rng(1)
    lines = ["item_id,side,reference,grasp"]
    for item in range(items):
        firmness = random.normal(14.0, 2.0)
        for side in ("left", "right"):
            reference = firmness + random.normal(0.0, 1.0)
            lines.append(f"A{item},{side},{reference:.2f},{3 * firmness + random.normal():.2f}")
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.slow
def test_qualify_prints_and_reports_every_figure(tmp_path: Path, palpate: Command) -> None:
    file, page = write_readings(tmp_path / "readings.csv"), tmp_path / "page.html"
    options = ("--tolerance", "1", "--unit", "lbf", "--limit", "14")
    shown = palpate("qualify", file, *options, "--report", page).out
    assert shown.startswith("40 items, 80 paired readings")
    for words in ("limit of agreement", "maximum R squared", "below 14", "grasps to average"):
        assert words in shown
    assert page.read_text().count("<svg") == 2
    assert "already exists" in palpate.refused("qualify", file, "--report", page)
    document = palpate("qualify", file, "--json").document
    assert document["items"] == 40
    assert document["tolerance"] == pytest.approx(document["scatter"]["reference"]["within"])
    figure = document["figures"]["r_squared_ceiling"]
    assert figure["low"] < figure["value"] < figure["high"] < 1.0
