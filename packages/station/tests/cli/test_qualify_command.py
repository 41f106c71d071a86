"""`palpate qualify`: tables, workbooks, the store, and the line to the buyer's unit."""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import openpyxl
import pytest
from packages.station.tests.cli.stored import stored_grasp
from tests.commands import Command

from palpate_station.qualify import agreement
from palpate_station.qualify.conversion import Conversion
from palpate_station.store import Store

pytestmark = pytest.mark.usefixtures("folder")
HEAD = ["item_id", "side", "reference", "grasp"]


@pytest.fixture(autouse=True, scope="module")
def few_draws() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(agreement, "_DRAWS", 50)
        yield


def make_rows(*, related: bool = True) -> list[list[object]]:
    """Return 20 items of two sides: reference 8 to 18 lbf, grasp four times as much."""
    random = np.random.default_rng(1)
    rows: list[list[object]] = []
    for item in range(20):
        true = random.uniform(8.0, 18.0)
        for side in ("blush", "shade"):
            seen = true if related else random.uniform(8.0, 18.0)
            reference = round(true + random.normal(0.0, 0.3), 2)
            rows.append([item, side, reference, round(4 * seen + random.normal(0.0, 1.0), 2)])
    return rows


def write_csv(path: Path, rows: list[list[object]], *, columns: int = 4) -> Path:
    with path.open("w", newline="") as file:
        csv.writer(file).writerows([row[:columns] for row in [HEAD, *rows]])
    return path


def fill_store(rows: list[list[object]]) -> None:
    with Store.open() as store:
        store.add_grasps(
            stored_grasp(str(item), {"firmness": float(str(grasp))}, hours=number)
            for number, (item, _, _, grasp) in enumerate(rows)
        )


def test_workbook_and_store_give_the_same_qualification_as_the_table(
    folder: Path, palpate: Command
) -> None:
    rows = make_rows()
    expected = palpate("qualify", write_csv(folder / "all.csv", rows), "--json").document
    assert expected["related"]
    book = openpyxl.Workbook()
    for row in [HEAD, *rows]:
        book.active.append(row)
    book.save(folder / "all.xlsx")
    assert palpate("qualify", "all.xlsx", "--json").document == expected
    fill_store(rows)
    references = write_csv(folder / "references.csv", rows, columns=3)
    stored = palpate("qualify", references, "--measurement", "firmness", "--json").document
    assert stored == expected


def test_invalid_workbook_is_refused_with_its_name(folder: Path, palpate: Command) -> None:
    (folder / "broken.xlsx").write_bytes(b"PK no workbook")
    assert "broken.xlsx" in palpate.refused("qualify", "broken.xlsx")
    book = openpyxl.Workbook()
    book.active.append(["item", "reference"])
    book.active.append(["A1", 3])
    book.save(folder / "columns.xlsx")
    assert "columns.xlsx, first sheet" in palpate.refused("qualify", "columns.xlsx")


def test_saved_line_converts_grasps_to_the_unit_of_the_reference(
    folder: Path, palpate: Command
) -> None:
    rows = make_rows()
    fill_store(rows)
    references = write_csv(folder / "references.csv", rows, columns=3)
    command = ("qualify", references, "--measurement", "firmness", "--unit", "lbf")
    palpate(*command, "--save", "lbf.json")
    line = Conversion.load(folder / "lbf.json")
    answers = [line.convert(float(str(row[3]))) for row in rows]
    assert all(one["unit"] == "lbf" for one in answers)
    inside = [one["low"] <= row[2] <= one["high"] for one, row in zip(answers, rows, strict=True)]
    assert np.mean(inside) >= 0.9
    assert line.half_width < 2.0
    assert line.simulated
    assert line.convert(1000.0)["value"] is None
    assert "already exists" in palpate.refused(*command, "--save", "lbf.json")
    (folder / "lbf.json").write_text(json.dumps({"format": "palpate-reference-1"}))
    assert "lbf.json" in palpate.refused("serve", "--rig", "sim-rigid", "--reference", "lbf.json")


def test_line_without_a_relation_is_not_saved(folder: Path, palpate: Command) -> None:
    rows = make_rows(related=False)
    fill_store(rows)
    references = write_csv(folder / "references.csv", rows, columns=3)
    out, err = palpate(
        *("qualify", references, "--measurement", "firmness", "--unit", "lbf"),
        *("--save", "lbf.json"),
        status=2,
    )
    assert err.startswith("palpate: --save lbf.json: no relation")
    # The table shows why.
    assert "scatter" in out
    assert not (folder / "lbf.json").exists()
