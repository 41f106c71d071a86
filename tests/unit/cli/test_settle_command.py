"""`palpate settle`: documents, tables, plots and refusals."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import openpyxl
import pyarrow.parquet as pq
import pytest
from tests.commands import Command


@pytest.fixture
def holds_csv(tmp_path: Path) -> Path:
    """Five falling holds of 21 s, one of 8 s, one constant, one single sample."""
    random = np.random.default_rng(3)
    lines = ["hold_id,time_s,value"]
    for number in range(6):
        time_s = np.arange(0, 8 if number == 5 else 21, 0.1)
        values = 100 - (4 + number) * np.log(time_s + 0.4) + 0.05 * random.normal(size=time_s.size)
        lines += [f"h{number},{t:.1f},{v:.4f}" for t, v in zip(time_s, values, strict=True)]
    lines += [f"flat,{t / 10:.1f},7" for t in range(210)]
    lines += ["single,0,3.5"]
    path = tmp_path / "holds.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def document(palpate: Command, *arguments: object) -> dict:
    printed = palpate("settle", *arguments, "--json")
    assert printed.err == ""
    return printed.document


def test_settle_predicts_every_hold_and_scores_those_with_a_settled_value(
    holds_csv: Path, palpate: Command
) -> None:
    found = document(palpate, holds_csv)
    rows = {row["hold_id"]: row for row in found["rows"]}
    assert list(rows) == ["h0", "h1", "h2", "h3", "h4", "h5", "flat", "single"]
    assert {(row["method"], row["cutoff_s"]) for row in found["rows"]} == {("relaxation", 2.5)}
    assert rows["h5"]["settled"] is rows["h5"]["error_percent"] is None
    assert rows["h5"]["predicted"] is not None
    assert rows["flat"]["predicted"] == pytest.approx(7)
    assert rows["flat"]["error_of_remaining_percent"] is None
    assert rows["single"]["predicted"] == 3.5
    (entry,) = found["summary"]
    assert (entry["holds"], entry["holds_with_settled_value"]) == (8, 6)
    assert " 6 of 8 " in palpate("settle", holds_csv).out


def test_settle_names_a_hold_that_begins_after_the_horizon(
    tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "late.csv"
    rows = "".join(f"a,{60 + k / 10:.1f},{9 - k / 100:.2f}\n" for k in range(250))
    path.write_text("hold_id,time_s,value\n" + rows)
    assert "hold a begins at 60 s" in palpate("settle", path).err
    assert "begins" not in palpate("settle", path, "--horizon", 80).err


def test_settle_fit_on_changes_intervals_but_not_predictions(
    holds_csv: Path, palpate: Command
) -> None:
    methods = ("--method", "relaxation", "--method", "exponential", "--level", "0.5")
    plain = document(palpate, holds_csv, *methods)["rows"]
    assert [row["method"] for row in plain[:2]] == ["relaxation", "exponential"]
    printed = palpate("settle", holds_csv, *methods, "--fit-on", holds_csv, "--json")
    assert "holds last 20 s; intervals from fewer than 20" in printed.err
    fitted = printed.document["rows"]
    assert [r["high"] for r in plain[::2]] != [r["high"] for r in fitted[::2]]
    assert {r["high"] for r in plain[1::2]} == {None}
    assert any(r["high"] is not None for r in fitted[1::2])
    assert [r["predicted"] for r in plain] == [r["predicted"] for r in fitted]


def test_settle_learn_from_affects_only_relaxation(
    holds_csv: Path, tmp_path: Path, palpate: Command
) -> None:
    own = tmp_path / "own.csv"
    own.write_bytes(holds_csv.read_bytes())
    methods = ("--method", "relaxation", "--method", "exponential")
    plain = document(palpate, holds_csv, *methods)["rows"]
    trained = document(palpate, holds_csv, *methods, "--learn-from", own)["rows"]
    before, after = (
        np.median([abs(r["error_percent"]) for r in rows[::2] if r["error_percent"] is not None])
        for rows in (plain, trained)
    )
    assert after < before
    assert plain[1::2] == trained[1::2]


def test_settle_until_half_width_reports_the_decision_time(
    holds_csv: Path, palpate: Command
) -> None:
    found = document(palpate, holds_csv, "--until-half-width", "5")
    (entry,) = found["summary"]
    decided = [row["cutoff_s"] for row in found["rows"] if row["decided"]]
    assert entry["holds_decided"] == len(decided) >= 5
    assert entry["median_decision_s"] == pytest.approx(np.median(decided))
    for row in found["rows"]:
        if row["decided"]:
            assert (row["high"] - row["low"]) / 2 <= 0.05 * abs(row["predicted"])
    found = document(palpate, holds_csv, "--until-half-width", "5", "--cutoff", "2.5")
    assert ["median_decision_s" in entry for entry in found["summary"]] == [False, True]


def test_settle_out_writes_same_results_to_json_csv_and_parquet(
    holds_csv: Path, tmp_path: Path, palpate: Command
) -> None:
    # A spreadsheet would compute this name.
    holds_csv.write_text(holds_csv.read_text().replace("h0", "=1+1"))
    found = document(palpate, holds_csv, "--out", tmp_path / "all.json")
    assert json.loads((tmp_path / "all.json").read_text()) == found
    palpate("settle", holds_csv, "--out", tmp_path / "rows.parquet")
    assert pq.read_table(tmp_path / "rows.parquet").to_pylist() == found["rows"]
    palpate("settle", holds_csv, "--out", tmp_path / "rows.csv")
    with (tmp_path / "rows.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["hold_id"] for row in rows[:2]] == ["'=1+1", "h1"]
    assert float(rows[0]["predicted"]) == found["rows"][0]["predicted"]
    assert rows[5]["settled"] == ""


@pytest.mark.parametrize("read_by", ["argument", "--fit-on"])
def test_settle_out_does_not_overwrite_its_input(
    read_by: str, holds_csv: Path, tmp_path: Path, palpate: Command
) -> None:
    other = tmp_path / "other.csv"
    other.write_bytes(holds_csv.read_bytes())
    before = other.read_bytes()
    read = (other,) if read_by == "argument" else (holds_csv, "--fit-on", other)
    error = palpate("settle", *read, "--out", tmp_path / "." / "other.csv", status=2).err
    assert "would be lost" in error
    assert other.read_bytes() == before


def write_press(path: Path, header: str, *, row: str) -> Path:
    """Write a sensor at rest for 3 s, then pressed for 24 s; `row` formats its time and ohms."""
    time_s = np.arange(0, 27, 0.1)
    values = np.where(time_s < 3, 900.0, 400.0 - 9.0 * np.log1p(np.maximum(time_s - 3, 0) / 0.3))
    rows = [row.format(t=t, v=v) for t, v in zip(time_s, values, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


SETTLED_OHM = 400 - 9 * np.log1p(20 / 0.3)


def test_settle_mean_of_columns_predicts_one_hold_of_the_known_unit(
    tmp_path: Path, palpate: Command
) -> None:
    path = write_press(tmp_path / "pixels.csv", "time_s,a_ohm,b_ohm", row="{t:.1f},{v:.1f},{v:.1f}")
    (row,) = document(palpate, path, "--rest", "0:2.5", "--mean")["rows"]
    assert row["hold_id"] == "pixels:mean change:1"
    assert row["settled"] == pytest.approx(100 * (SETTLED_OHM / 900 - 1), rel=0.01)
    path = write_press(tmp_path / "a.csv", "time_s,left", row="{t:.1f},{v:.0f}")
    rest = ("--rest", "0:2", "--mean")
    assert "the unit is unknown" in palpate.refused("settle", path, *rest)
    assert palpate("settle", path, *rest, "--unit", "ohm").out


def test_settle_names_the_sheet_and_reads_another(tmp_path: Path, palpate: Command) -> None:
    book = openpyxl.Workbook()
    book.active.append(["Series", "n = 3"])
    for title, scale in (("First", 1.0), ("Second", 2.0)):
        sheet = book.create_sheet(title)
        sheet.append(["time_s", "R_ohm"])
        for t in np.arange(0, 27, 0.1):
            held = 400.0 - 9.0 * np.log1p(max(t - 3, 0) / 0.3)
            sheet.append([round(float(t), 1), scale * float(900.0 if t < 3 else held)])
    book.save(path := tmp_path / "book.xlsx")
    printed = palpate("settle", path, "--json")
    assert "'First'" in printed.err
    first = printed.document["rows"][0]["settled"]
    [row] = document(palpate, path, "--sheet", "Second")["rows"]
    assert row["settled"] == pytest.approx(2 * first, rel=1e-6)
    assert "available: Sheet, First, Second" in palpate.refused("settle", path, "--sheet", "x")


def write_holds(path: Path, rows: list[str]) -> Path:
    path.write_text("\n".join(["hold_id,time_s,value", *rows]) + "\n")
    return path


def test_settle_beyond_the_proven_horizon_is_not_ok(tmp_path: Path, palpate: Command) -> None:
    rows = [
        f"h{k},{t:.1f},{(100 + k) * (1 - 0.03 * np.log1p(t)):.4f}"
        for k in range(9)
        for t in np.arange(0, 41, 0.2)
    ]
    new = write_holds(tmp_path / "new.csv", rows[:205])
    learn = ("--learn-from", write_holds(tmp_path / "past.csv", rows[205:]))
    statuses = [
        document(palpate, new, *options)["rows"][0]["status"]
        for options in ((), ("--horizon", "40"), ("--horizon", "40", *learn))
    ]
    assert statuses == ["ok", "unproven", "ok"]
