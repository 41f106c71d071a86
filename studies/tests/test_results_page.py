"""Tables 1, 4 and 5 on the results page are those of the kept results, row by row."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from palpate_studies import table1, table4, table5
from palpate_studies.misfit import sentence
from palpate_studies.report import Table

DOCS = Path(__file__).parents[2] / "docs"


def figures(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((DOCS / "kept" / f"{name}.json").read_text())["figures"]
    return found


def section(study: str) -> str:
    """Return what the page has of a study, from its command to the next heading."""
    page = (DOCS / "results.md").read_text()
    return page.split(f"`palpate study {study}")[1].split("\n## ")[0]


def shown_rows(table: Table, part: str) -> tuple[list[str], list[str]]:
    """Return rows of the page under the table's title, and all that the table has."""
    assert f"**{table.title}**" in part
    shown = part.split(f"**{table.title}**")[1].split("\n\n")[1].splitlines()[2:]
    return shown, table.as_markdown().splitlines()[4:]


@pytest.mark.parametrize("family", ["two-mode", "slow-power", "hetero"])
def test_table_1_has_every_published_entry_and_marks_inputs(family: str) -> None:
    table = table1.error_table(family, figures("table1")["families"][family])
    shown, every = shown_rows(table, section("table1"))
    assert shown == every
    assert len(shown) == len(table1.CUTOFFS_S)
    marked = sum(cell.strip().endswith("*") for row in shown for cell in row.split("|"))
    inputs = figures("table1")["calibration_inputs"][family]
    assert marked == sum(len(used) for used in inputs.values())


def test_table_4_has_every_published_entry() -> None:
    lines = {name: np.array(v) for name, v in figures("table4")["lines"]["lab"].items()}
    shown, every = shown_rows(table4.line_table("lab", lines), section("table4"))
    assert shown == every
    assert len(shown) == len(table4.PUBLISHED)


def test_table_5_has_every_published_entry() -> None:
    kept = figures("table5")
    table = table5.error_table(kept["rows"], grasps=kept["grasps"])
    shown, every = shown_rows(table, section("table5"))
    assert set(shown) <= set(every)
    for level in table5.LEVELS:
        for name in table5.PUBLISHED_N:
            assert any(row.startswith(f"| {level} | {name} |") for row in shown)


def test_misfits_are_counted_as_the_kept_results_count_them() -> None:
    for study, of in (("table1", "family"), ("table4", "level"), ("table5", "level")):
        part = section(study)
        for name, counts in figures(study)["misfit"].items():
            assert sentence(counts, of=f"Table {study[-1]} by the {of} {name}") in part
