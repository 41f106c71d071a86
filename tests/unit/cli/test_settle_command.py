"""`palpate settle`: documents, tables, plots and refusals."""

from __future__ import annotations

import csv
import itertools
import json
import os
import re
import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from matplotlib.figure import Figure
from tests.commands import Command
from tests.pdf_fonts import check_fonts

from palpate.cli import settle_report
from palpate.demo.recordings import write_recordings

ROW_KEYS = [
    *("hold_id", "channel", "method", "cutoff_s", "predicted", "low", "high", "settled"),
    *("error_percent", "status"),
]
SUMMARY_KEYS = [
    *("method", "cutoff_s", "holds", "median_abs_error_percent", "mean_abs_error_percent"),
    *("p90_abs_error_percent", "median_error_of_remaining_percent", "coverage"),
    "median_half_width_percent",
]


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
    assert printed.out.endswith("}\n")
    return printed.document


def test_settle_json_matches_the_published_schema(holds_csv: Path, palpate: Command) -> None:
    found = document(palpate, holds_csv)
    assert list(found["rows"][0])[: len(ROW_KEYS)] == ROW_KEYS
    assert list(found["summary"][0])[: len(SUMMARY_KEYS)] == SUMMARY_KEYS
    assert [row["hold_id"] for row in found["rows"]] == [
        *("h0", "h1", "h2", "h3", "h4", "h5", "flat", "single")
    ]
    assert {(row["method"], row["cutoff_s"]) for row in found["rows"]} == {("relaxation", 2.5)}
    rows = {row["hold_id"]: row for row in found["rows"]}
    assert rows["h5"]["settled"] is None
    assert rows["h5"]["error_percent"] is None
    assert rows["h5"]["predicted"] is not None
    assert rows["flat"]["predicted"] == pytest.approx(7)
    assert rows["flat"]["error_of_remaining_percent"] is None
    assert rows["single"]["predicted"] == 3.5
    assert found["summary"][0]["holds"] == 8
    assert found["summary"][0]["holds_with_settled_value"] == 6


def test_settle_json_figures_are_consistent(holds_csv: Path, palpate: Command) -> None:
    found = document(palpate, holds_csv, "--method", "recorded", "--cutoff", "5", "--cutoff", "1")
    rows = [row for row in found["rows"] if row["error_percent"] is not None]
    for row in rows:
        error = 100 * (row["predicted"] - row["settled"]) / abs(row["settled"])
        assert row["error_percent"] == pytest.approx(error)
        assert row["low"] is None
    assert [entry["cutoff_s"] for entry in found["summary"]] == [5.0, 1.0]
    errors = [abs(row["error_percent"]) for row in rows if row["cutoff_s"] == 5.0]
    assert found["summary"][0]["median_abs_error_percent"] == pytest.approx(np.median(errors))
    assert found["summary"][0]["median_error_of_remaining_percent"] == pytest.approx(100)
    assert found["summary"][0]["coverage"] is None


def test_settle_rows_of_files_and_methods_have_a_stable_order(
    holds_csv: Path, palpate: Command
) -> None:
    arguments = (holds_csv, holds_csv, "--method", "exponential", "--method", "recorded")
    first = document(palpate, *arguments)
    assert first == document(palpate, *arguments)
    assert len(first["rows"]) == 2 * 8 * 2
    assert [row["method"] for row in first["rows"][:2]] == ["exponential", "recorded"]


def test_settle_with_fit_on_option_changes_intervals_but_not_predictions(
    holds_csv: Path, palpate: Command
) -> None:
    methods = ("--method", "relaxation", "--method", "exponential", "--level", "0.5")
    plain = document(palpate, holds_csv, *methods)
    fitted = palpate("settle", holds_csv, *methods, "--fit-on", holds_csv, "--json").document
    assert [r["high"] for r in plain["rows"][::2]] != [r["high"] for r in fitted["rows"][::2]]
    assert {r["high"] for r in plain["rows"][1::2]} == {None}
    assert any(r["high"] is not None for r in fitted["rows"][1::2])
    assert [r["predicted"] for r in plain["rows"]] == [r["predicted"] for r in fitted["rows"]]


def test_settle_learn_from_affects_only_relaxation(
    holds_csv: Path, tmp_path: Path, palpate: Command
) -> None:
    own = tmp_path / "own.csv"
    own.write_bytes(holds_csv.read_bytes())
    methods = ("--method", "relaxation", "--method", "exponential")
    plain = document(palpate, holds_csv, *methods)
    trained = document(palpate, holds_csv, *methods, "--learn-from", own)
    errors = [
        [
            abs(r["error_percent"])
            for r in found["rows"]
            if r["method"] == "relaxation" and r["error_percent"] is not None
        ]
        for found in (plain, trained)
    ]
    assert np.median(errors[1]) < np.median(errors[0])
    others = [
        [r for r in found["rows"] if r["method"] == "exponential"] for found in (plain, trained)
    ]
    assert others[0] == others[1]


def test_settle_learn_from_refuses_the_predicted_holds(holds_csv: Path, palpate: Command) -> None:
    error = palpate("settle", holds_csv, "--learn-from", holds_csv, status=2).err
    assert "errors on training holds are meaningless" in error


def test_settle_warns_of_few_calibration_holds_and_missing_intervals(
    holds_csv: Path, palpate: Command
) -> None:
    error = palpate("settle", holds_csv, "--fit-on", holds_csv).err
    assert "holds last 20 s; intervals from fewer than 20" in error
    error = palpate("settle", holds_csv, "--method", "recorded", "--until-half-width", "5").err
    assert "recorded has no interval without --fit-on" in error


def test_settle_until_half_width_reports_the_decision_time(
    holds_csv: Path, palpate: Command
) -> None:
    found = document(palpate, holds_csv, "--until-half-width", "5")
    [entry] = found["summary"]
    decided = [row["cutoff_s"] for row in found["rows"] if row["decided"]]
    assert entry["holds_decided"] == len(decided) >= 5
    assert entry["median_decision_s"] == pytest.approx(np.median(decided))
    assert entry["until_half_width_percent"] == 5.0
    for row in found["rows"]:
        if row["decided"]:
            assert (row["high"] - row["low"]) / 2 <= 0.05 * abs(row["predicted"])


def test_settle_cutoff_combines_with_until_half_width(holds_csv: Path, palpate: Command) -> None:
    found = document(palpate, holds_csv, "--until-half-width", "5", "--cutoff", "2.5")
    assert ["median_decision_s" in entry for entry in found["summary"]] == [False, True]


def test_settle_out_writes_same_results_to_json_csv_and_parquet(
    holds_csv: Path, tmp_path: Path, palpate: Command
) -> None:
    found = document(palpate, holds_csv, "--out", tmp_path / "all.json")
    assert json.loads((tmp_path / "all.json").read_text()) == found
    document(palpate, holds_csv, "--out", tmp_path / "rows.parquet")
    assert pq.read_table(tmp_path / "rows.parquet").to_pylist() == found["rows"]
    document(palpate, holds_csv, "--out", tmp_path / "rows.csv")
    with (tmp_path / "rows.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["hold_id"] for row in rows] == [row["hold_id"] for row in found["rows"]]
    assert float(rows[0]["predicted"]) == found["rows"][0]["predicted"]
    assert rows[5]["settled"] == ""


def test_settle_out_csv_escapes_spreadsheet_formulas(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "holds.csv"
    rows = [f"=1+1,{t},{9 - t / 50}" for t in range(210)]
    path.write_text("\n".join(["hold_id,time_s,value", *rows]) + "\n")
    found = document(palpate, path, "--out", tmp_path / "rows.csv")
    assert found["rows"][0]["hold_id"] == "=1+1"
    with (tmp_path / "rows.csv").open() as stream:
        assert next(csv.DictReader(stream))["hold_id"] == "'=1+1"


@pytest.mark.parametrize("options", [["--cutoff", "2.5"], ["--until-half-width", "2.5"]])
def test_settle_warns_once_of_times_in_milliseconds(
    options: list[str], tmp_path: Path, palpate: Command
) -> None:
    path = tmp_path / "holds.csv"
    rows = [f"{hold},{100 * t},{9 - t / 50}" for hold in "ab" for t in range(210)]
    path.write_text("\n".join(["hold_id,time_s,value", *rows]) + "\n")
    error = palpate("settle", path, *options).err
    assert error.count("a sample every 100 s; time_s must be in seconds; convert milliseconds") == 1


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


def test_method_without_intervals_has_no_column_of_them(holds_csv: Path, palpate: Command) -> None:
    printed = palpate("settle", holds_csv, "--method", "recorded").out
    assert "±" not in printed.splitlines()[1]
    assert "half-width of" not in printed


def test_refused_rest_names_the_file(tmp_path: Path, palpate: Command) -> None:
    path = tmp_path / "a.csv"
    path.write_text("time_s,ohm\n" + "".join(f"{t},{90 if t < 20 else 50}\n" for t in range(60)))
    error = palpate.refused("settle", path, "--rest", "70:80")
    assert error.startswith(f"palpate: {path}: ohm: 0 readings at rest")


def test_scores_state_how_many_holds_they_are_from(holds_csv: Path, palpate: Command) -> None:
    assert " 6 of 8 " in palpate("settle", holds_csv).out


def test_columns_without_a_hold_for_the_same_reason_share_a_line(
    tmp_path: Path, palpate: Command
) -> None:
    lines = ["recording_id,time_s,a_ohm,b_ohm,c_ohm"]
    for name in "pq":
        for t in np.arange(0, 30, 0.05):
            held = 4000 - 100 * np.log(t - 4.6) if t >= 5 else 9000
            lines.append(f"{name},{t:.2f},{held:.1f},{9000 + t % 0.1:.2f},{9000 + t % 0.1:.2f}")
    (tmp_path / "two.csv").write_text("\n".join(lines) + "\n")
    notes = palpate("settle", tmp_path / "two.csv").err.splitlines()
    assert [note.partition("two.csv: ")[2].split(": ")[:2] for note in notes] == [
        ["two:p", "b_ohm, c_ohm"],
        ["two:q", "b_ohm, c_ohm"],
    ]


def test_titles_of_a_plot_keep_a_number_with_its_unit(
    holds_csv: Path, tmp_path: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[Figure] = []
    monkeypatch.setattr(settle_report, "save_figure", lambda figure, _: drawn.append(figure))
    palpate("settle", holds_csv, "--plot", tmp_path / "plot.png")
    titles = [axis.get_title(loc="left") for axis in drawn[0].axes]
    errors = [title.split("\n")[0] for title in titles if "error:" in title]
    assert len(errors) == 2
    assert all(error.endswith("\N{NO-BREAK SPACE}%") for error in errors)


def test_name_of_a_hold_is_printed_as_it_is(tmp_path: Path, palpate: Command) -> None:
    rows = "".join(f":x:,{t / 10:.1f},{100 - np.log(t + 4):.4f}\n" for t in range(210))
    (tmp_path / "holds.csv").write_text(f"hold_id,time_s,value\n{rows}")
    assert ":x: " in palpate("settle", tmp_path / "holds.csv").out


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["png", "svg", "pdf"])
def test_settle_writes_a_plot(
    holds_csv: Path, tmp_path: Path, ending: str, palpate: Command
) -> None:
    plot = tmp_path / f"plot.{ending}"
    palpate("settle", holds_csv, "--method", "relaxation", "--method", "recorded", "--plot", plot)
    magic = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[ending]
    assert plot.read_bytes().startswith(magic)
    if ending == "pdf":
        check_fonts(plot)


def test_settle_tables_fit_a_terminal(holds_csv: Path, palpate: Command) -> None:
    captured = palpate("settle", holds_csv, "--until-half-width", "5", "--method", "relaxation")
    assert captured.err == ""
    for text in ("Value predicted for 20 s", "relaxation", "in 90%", "± fell below 5 %", "h5"):
        assert text in captured.out


@pytest.mark.slow
def test_settle_tables_show_units(tmp_path: Path, palpate: Command) -> None:
    write_recordings(tmp_path)
    shown = palpate("settle", tmp_path / "ohm.csv", "--cutoff", "1", "--cutoff", "2.5").out
    assert "Value in ohm predicted for 20 s by relaxation: 8 predictions" in shown
    divider = ("--adc-bits", "10", "--reference-ohm", "4700", "--sensor-leg", "upper")
    assert "Value in ohm predicted" in palpate("settle", tmp_path / "counts.csv", *divider).out
    heads = next(
        line
        for line in palpate("settle", tmp_path, "--out", tmp_path / "all.json").out.splitlines()
        if "cut-off" in line
    )
    assert heads.split()[:4] == ["hold", "cut-off", "predicted", "unit"]
    rows = json.loads((tmp_path / "all.json").read_text())["rows"]
    assert {row["unit"] for row in rows} == {"ohm", "counts"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["--method", "magic"],
            "no method 'magic'; available: recorded, exponential, log_law, log_law_early",
        ),
        (["--cutoff", "0"], "--cutoff 0"),
        (["--cutoff", "nan"], "--cutoff nan"),
        (["--cutoff", "21"], "at most the horizon (20 s)"),
        (["--cutoff", "soon"], "--cutoff"),
        (["--level", "1"], "--level 1"),
        (["--level", "0"], "--level 0"),
        (["--horizon", "-3"], "--horizon -3"),
        (["--horizon", "inf"], "--horizon inf"),
        (["--until-half-width", "0"], "--until-half-width 0"),
        (["--plot", "plot.bmp"], "a plot ends in"),
        (["--plot", "nowhere/plot.png"], "no folder nowhere"),
        (["--out", "rows.txt"], ".json, .csv or .parquet"),
        (["--out", "nowhere/rows.csv"], "the folder nowhere does not exist"),
        (["--fit-on", "nowhere.csv"], "nowhere.csv: no such file"),
        (["--bogus"], "--bogus"),
    ],
)
def test_settle_invalid_options_exit_with_2_in_one_line(
    holds_csv: Path, palpate: Command, arguments: list[str], message: str
) -> None:
    assert message in palpate.refused("settle", holds_csv, *arguments)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"hold_id,value\na,1\n", "line 1: no column time_s"),
        (b"hold_id,time_s,value\na,0,1\na,1,nan\n", "line 3: value is 'nan', not a finite number"),
        (b"hold_id,time_s,value\na,0,1\na,1,oops\n", "line 3: value is 'oops'"),
        (b"hold_id,time_s,value\na,1,1\na,0,1\n", "line 3: time decreases in hold a"),
        (bytes(range(256)) * 8, "not a text file"),
    ],
)
def test_settle_bad_file_exits_with_2_in_one_line(
    tmp_path: Path, palpate: Command, content: bytes, message: str
) -> None:
    path = tmp_path / "bad.csv"
    path.write_bytes(content)
    out = tmp_path / "unwritten.json"
    error = palpate.refused("settle", path, "--json", "--out", out)
    assert f"{path}" in error
    assert message in error
    assert not out.exists()


@pytest.mark.parametrize(
    ("header", "hold"), [("hold_id,time_s,value", "A,"), ("time_s,percent", "")]
)
def test_settle_overflowing_values_are_refused_in_one_line(
    tmp_path: Path, palpate: Command, header: str, hold: str
) -> None:
    rows = (f"{hold}{number / 20},{(-1) ** number * 1.7e308}" for number in range(400))
    path = tmp_path / "huge.csv"
    path.write_text("\n".join((header, *rows)))
    assert f"{path}" in palpate.refused("settle", path, "--plot", tmp_path / "plot.png")


def test_settle_pipe_is_read_once_and_refused_if_reread(
    holds_csv: Path, tmp_path: Path, palpate: Command
) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    error = palpate("settle", pipe, "--plot", tmp_path / "plot.png", status=2).err
    assert "a pipe can be read only once" in error
    writer = threading.Thread(target=lambda: pipe.write_bytes(holds_csv.read_bytes()))
    writer.start()
    found = document(palpate, pipe)
    writer.join()
    assert len(found["rows"]) == 8


def test_settle_of_a_folder_without_recordings_is_refused(tmp_path: Path, palpate: Command) -> None:
    assert "no recordings in this folder" in palpate("settle", tmp_path, status=2).err
    assert palpate("settle", status=2).err.count("\n") == 1


@pytest.mark.slow
def test_settle_real_holds_have_finite_predictions(real_data: Path, palpate: Command) -> None:
    found = document(palpate, real_data / "holds_cbsilicone.csv.gz", "--cutoff", "2.5")
    assert len(found["rows"]) == found["summary"][0]["holds"] == 131
    assert all(row["predicted"] is not None for row in found["rows"])
    assert all(row["settled"] is not None for row in found["rows"])


@pytest.mark.parametrize("columns", [60, 80])
def test_settle_table_in_a_narrow_terminal_has_every_column(
    holds_csv: Path, palpate: Command, monkeypatch: pytest.MonkeyPatch, columns: int
) -> None:
    monkeypatch.setattr(settle_report, "PIPED_WIDTH", columns)
    lines = palpate("settle", holds_csv).out.splitlines()
    # A heading of two words may wrap to two lines.
    heads = [
        f"{above} {line}".split() for above, line in itertools.pairwise(lines) if "cut-off" in line
    ]
    holds = ["hold", "cut-off", "predicted", "±", "settled", "error", "status"]
    assert set(holds) <= set(heads[0])
    scores = ["method", "cut-off", "holds", "median", "mean", "p90", "of", "rest", "in", "90%", "±"]
    assert set(scores) <= set(heads[1])
    assert sum(line.rstrip().endswith(" ok") for line in lines) >= 5
    assert all(len(line) <= columns for line in lines)


def test_settle_mean_option_predicts_one_hold(tmp_path: Path, palpate: Command) -> None:
    time_s = np.arange(0, 26, 0.1)
    fall = np.where(time_s > 3, 0.5 - 0.1 * np.exp(-(time_s - 3) / 2), 0.0)
    rows = [
        f"{t:.1f},{1e3 * (1 - f):.2f},{9e3 * (1 - 0.4 * f):.2f}"
        for t, f in zip(time_s, fall, strict=True)
    ]
    path = tmp_path / "pixels.csv"
    path.write_text("\n".join(["time_s,a_ohm,b_ohm", *rows]) + "\n")
    options = ("--rest", "0:2.5", "--mean", "--method", "exponential")
    (row,) = document(palpate, path, *options)["rows"]
    assert row["hold_id"] == "pixels:mean change:1"
    assert row["predicted"] == pytest.approx(-35.0, abs=0.2)
    for wrong, words in (
        (["--mean"], "requires --rest START:END"),
        (["--rest", "3"], "give START:END in seconds"),
        (["--rest", "0:2", "--unit", "percent"], "converts ohms to relative changes"),
    ):
        assert words in palpate("settle", path, *wrong, status=2).err


def test_settle_rows_and_summary_of_one_hold_agree(tmp_path: Path, palpate: Command) -> None:
    time_s = np.arange(0, 21, 0.1)
    values = 40.0 + 8.0 * np.exp(-time_s / 4.0)
    rows = [f"h1,{time:.1f},{value:.6f}" for time, value in zip(time_s, values, strict=True)]
    path = tmp_path / "one.csv"
    path.write_text("\n".join(["hold_id,time_s,value", *rows]) + "\n")
    shown = palpate("settle", path, "--method", "relaxation", "--method", "recorded").out
    assert "relaxation: 1 hold\n" in re.sub(r" +\n", "\n", shown)
    # Both tables show the half-width in percent of the settled value.
    (row,) = re.findall(r"h1 .* ([\d.]+) % +[\d.]+\.\.", shown)
    (summary,) = re.findall(r"relaxation +2.5 s .* ([\d.]+) *\n", shown)
    assert float(row) == pytest.approx(float(summary), abs=0.06)
    # Statuses are counted for each method, so they add up to its holds.
    assert re.search(r"Status of relaxation: 1 \w+\nStatus of recorded: 1 \w+\n", shown)


def write_press(path: Path, header: str, row: Callable[[float, float], str]) -> Path:
    """Write a sensor at rest for 3 s, then pressed for 24 s."""
    time_s = np.arange(0, 27, 0.1)
    values = np.where(time_s < 3, 900.0, 400.0 - 9.0 * np.log1p(np.maximum(time_s - 3, 0) / 0.3))
    rows = [row(t, v) for t, v in zip(time_s, values, strict=True)]
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def test_settle_rest_asks_for_an_unknown_unit(tmp_path: Path, palpate: Command) -> None:
    path = write_press(tmp_path / "a.csv", "time_s,left", lambda t, v: f"{t:.1f},{v:.0f}")
    rest = ("--rest", "0:2", "--mean")
    assert "the unit is unknown" in palpate.refused("settle", path, *rest)
    assert palpate("settle", path, *rest, "--unit", "ohm").out


def test_settle_interval_replaces_a_missing_clock(tmp_path: Path, palpate: Command) -> None:
    path = write_press(tmp_path / "a.csv", "fsr", lambda t, v: f"{v:.1f}")
    assert "--interval" in palpate.refused("settle", path)
    [row] = document(palpate, path, "--interval", "0.1")["rows"]
    assert row["settled"] == pytest.approx(400 - 9 * np.log1p(20 / 0.3), rel=0.01)
    assert "--interval -1" in palpate.refused("settle", path, "--interval", "-1")


def test_settle_names_the_sheet_and_reads_another(tmp_path: Path, palpate: Command) -> None:
    openpyxl = pytest.importorskip("openpyxl")
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
    assert "--sheet" in printed.err
    first = printed.document["rows"][0]["settled"]
    [row] = document(palpate, path, "--sheet", "Second")["rows"]
    assert row["settled"] == pytest.approx(2 * first, rel=1e-6)
    assert "available: Sheet, First, Second" in palpate.refused("settle", path, "--sheet", "x")


def test_settle_beyond_the_proven_horizon_is_not_ok(tmp_path: Path, palpate: Command) -> None:
    rows = [
        f"h{k},{t:.1f},{(100 + k) * (1 - 0.03 * np.log1p(t)):.4f}"
        for k in range(9)
        for t in np.arange(0, 41, 0.2)
    ]
    for name, part in (("new", rows[:205]), ("past", rows[205:])):
        text = "\n".join(["hold_id,time_s,value", *part]) + "\n"
        (tmp_path / f"{name}.csv").write_text(text)
    new = tmp_path / "new.csv"
    statuses = [
        document(palpate, new, *options)["rows"][0]["status"]
        for options in ((), ("--horizon", "40"))
    ]
    assert statuses == ["ok", "unproven"]
    learned = document(palpate, new, "--horizon", "40", "--learn-from", tmp_path / "past.csv")
    assert learned["rows"][0]["status"] == "ok"


def test_settle_of_a_slow_logger_has_a_settled_value(tmp_path: Path, palpate: Command) -> None:
    rows = [f"a,{t},{100 - 5 * np.log1p(t):.4f}" for t in (0, *range(1, 40, 2))]
    path = tmp_path / "slow.csv"
    path.write_text("\n".join(["hold_id,time_s,value", *rows]) + "\n")
    [row] = document(palpate, path, "--cutoff", "7")["rows"]
    assert row["settled"] == pytest.approx(100 - 5 * np.log1p(19.75), rel=1e-3)
