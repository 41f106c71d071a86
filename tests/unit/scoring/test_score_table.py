"""`palpate.score`: the scores of `palpate settle` from Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.commands import Command

from palpate import read_holds, score

METHODS, CUTOFFS_S = ["relaxation", "recorded"], [1.0, 2.5]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path, time_s = tmp_path / "holds.csv", np.arange(0.0, 25.0, 0.1)
    with path.open("w") as file:
        file.write("hold_id,time_s,value\n")
        for name, top in (("a", 900.0), ("b", 700.0)):
            file.writelines(f"{name},{t:.1f},{top - 60 * np.log1p(t):.2f}\n" for t in time_s)
    return path


def test_score_agrees_with_the_settle_command(path: Path, palpate: Command) -> None:
    options = [text for name in METHODS for text in ("--method", name)]
    options += [text for cutoff_s in CUTOFFS_S for text in ("--cutoff", str(cutoff_s))]
    table = score(read_holds(path), methods=METHODS, cutoffs_s=CUTOFFS_S)
    printed = palpate("settle", path, *options, "--json").document
    assert table.to_dict()["summary"] == printed["summary"]
    lines = [line.rstrip() for line in palpate("settle", path, *options).out.splitlines()]
    assert [line for line in str(table).splitlines() if line.rstrip() not in lines] == []


def test_score_to_dataframe_has_a_row_per_method_and_cutoff(path: Path) -> None:
    frame = score(read_holds(path), methods=METHODS, cutoffs_s=CUTOFFS_S)
    table = frame.to_dataframe()
    assert list(zip(table["method"], table["cutoff_s"], strict=True)) == [
        (method, cutoff_s) for method in METHODS for cutoff_s in CUTOFFS_S
    ]
    assert (table["holds"] == 2).all()
