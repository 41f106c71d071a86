"""The history of grasps: entries, counts, CSV table and persistence."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from pathlib import Path

import pytest
from tests.full_disk import file_size_limit

from palpate_station.dashboard.folder import LISTED_GRASPS, Entry, History
from palpate_station.dashboard.panel_history import counts_html, entry_html
from palpate_station.records import BIN_COLUMNS

ENTRY = Entry(
    ended_at="2026-01-02T03:04:05+00:00",
    recording="grasp-1.mcap",
    simulated=True,
    item_id="A17",
    outcome="held",
    verdict="held and released",
    firmness="soft",
    kind="good",
    bin="ripe",
    why="ripe: soft",
    measured={"force_n": 2.5, "force_n_low": 2.0, "force_n_high": 3.0},
    curve=(0.0, 1.0, 2.5),
)


@pytest.fixture
def history(tmp_path: Path) -> History:
    return History(tmp_path)


def rows_of(history: History) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO("".join(history.csv_parts()), newline="")))


def test_history_is_restored_after_a_restart(tmp_path: Path) -> None:
    first = History(tmp_path / "data")
    for number in range(LISTED_GRASPS + 3):
        first.add(replace(ENTRY, recording=f"{number}.mcap"))
    again = History(tmp_path / "data")
    assert again.recent_grasps == first.recent_grasps
    assert again.recent_grasps[0].recording == f"{LISTED_GRASPS + 2}.mcap"
    assert len(again.recent_grasps) == LISTED_GRASPS
    assert again.outcomes.total() == 0, "each run counts from 0"
    assert (first.outcomes["held"], first.bins["ripe"]) == (LISTED_GRASPS + 3, LISTED_GRASPS + 3)


def test_lot_continues_after_a_restart_and_ends_with_the_next_lot(tmp_path: Path) -> None:
    def restart() -> History:
        return History(tmp_path, default_bin="by hand")

    restart().add(replace(ENTRY, item_id="A1"))
    assert (restart().lot.name, restart().lot.items) == ("", 1)
    restart().start_lot("Monday")
    steps = (("A1", "large", True), ("A1", "large", False), ("A2", "by hand", False))
    for item_id, bin_name, again in steps:
        restart().add(replace(ENTRY, item_id=item_id, bin=bin_name, again=again))
    restart().add(replace(ENTRY, item_id="A3", bin=None))
    restart().add(replace(ENTRY, item_id="A4", outcome="slipped"))
    restart().add(replace(ENTRY, item_id="", recording="unnamed.mcap"))
    lot = restart().lot
    assert (lot.name, lot.bins) == ("Monday", {"large": 1, "by hand": 1, "ripe": 1})
    restart().start_lot("Tuesday")
    assert (restart().lot.name, restart().lot.items) == ("Tuesday", 0)


def test_lot_has_the_items_that_the_store_has_in_its_batch(tmp_path: Path) -> None:
    history = History(tmp_path, default_bin="by hand")
    history.start_lot("Monday")
    large = replace(ENTRY, bin="large", again=False, stored=True, batch="Monday")
    for entry in (
        replace(large, item_id="A1"),
        replace(large, item_id="lost", stored=False),
        # Measured again: moved by an order to another batch, and not certain any more.
        replace(large, item_id="A2"),
        replace(large, item_id="A2", batch="Sunday"),
        replace(large, item_id="A3"),
        replace(large, item_id="A3", again=True),
        replace(large, item_id="A4", batch="Sunday"),
    ):
        history.add(entry)
    assert (history.lot.bins, History(tmp_path).lot.bins) == ({"large": 1}, {"large": 1})
    assert [history.find_sorted(name) is not None for name in ("A1", "A3", "lost")] == [
        True,
        False,
        False,
    ]


def test_history_with_truncated_lines_reads_and_adds_all_others(
    history: History, tmp_path: Path
) -> None:
    history.add(ENTRY)
    with (tmp_path / "grasps.jsonl").open("a") as lines:
        lines.write('{"ended_at": "2026-01\n[1, 2]\n{"ended_at": "2026-01')
    History(tmp_path).add(ENTRY)
    assert History(tmp_path).recent_grasps == [ENTRY, ENTRY]


@pytest.mark.parametrize("start", ["odd, ", "=", "+", "-", "@", "\t=", "\r=", " ="])
def test_history_csv_has_units_and_no_cell_that_a_spreadsheet_executes(
    history: History, start: str
) -> None:
    typed = f'{start}HYPERLINK("http://x/";1)'
    history.add(replace(ENTRY, item_id=typed, bin=typed, why=typed, measured={"force_n_low": -1.0}))
    (row,) = rows_of(history)
    shown = typed if start == "odd, " else f"'{typed}"
    assert {row["item_id"], row["bin"], row["bin_why"]} == {shown}
    assert (row["force_n_low"], row["stiffness_n_per_mm"]) == ("-1.0", "")
    assert row["simulated"] == "True"
    assert history.recent_grasps[0].item_id == typed


def test_history_csv_has_the_bin_its_reason_and_who_decided(history: History) -> None:
    history.add(replace(ENTRY, probability=0.75, again=True))
    history.add(replace(ENTRY, bin=None, why="the store does not answer"))
    found, missing = ([row[name] for name in BIN_COLUMNS] for row in rows_of(history))
    assert found == ["ripe", "ripe: soft", "0.75", "True", "palpate"]
    assert missing == ["", "the store does not answer", "", "", ""]


def test_history_finds_a_grasp_by_the_new_name_of_its_recording(
    history: History, tmp_path: Path
) -> None:
    history.add(ENTRY)
    version = history.version
    history.rename("grasp-1.mcap", "ripe.mcap")
    assert history.version > version
    assert history.find_grasp("grasp-1.mcap") is None
    for one in (history, History(tmp_path)):
        assert one.recent_grasps[0].recording == "ripe.mcap"
        assert one.find_grasp("ripe.mcap") == ("held", "A17", True)
        assert rows_of(one)[0]["recording"] == "ripe.mcap"


def test_history_rename_on_a_full_disk_preserves_every_grasp(
    history: History, tmp_path: Path
) -> None:
    file = tmp_path / "grasps.jsonl"
    history.add(ENTRY)
    before = file.read_bytes()
    with file_size_limit(len(before) + 10), pytest.raises(OSError, match="No space left"):
        history.rename("grasp-1.mcap", "ripe.mcap")
    assert file.read_bytes() == before
    assert history.recent_grasps == [ENTRY]


def test_entry_and_counts_escape_entered_text(history: History) -> None:
    nasty = "<script>'\"&"
    shown = entry_html(replace(ENTRY, item_id=nasty, why=nasty, bin=nasty, firmness=nasty))
    assert "<script>" not in shown
    assert "SIMULATED" in shown
    history.add(replace(ENTRY, bin=nasty))
    assert "<script>" not in counts_html(history, rules=True)


def test_history_rename_preserves_lines_of_another_program(
    history: History, tmp_path: Path
) -> None:
    file = tmp_path / "grasps.jsonl"
    for number in range(3):
        history.add(replace(ENTRY, recording=f"{number}.mcap"))
    before = file.read_bytes()
    # Another program writes a grasp to the same file.
    History(tmp_path).add(replace(ENTRY, recording="other.mcap"))
    history.rename("1.mcap", "a.mcap")
    history.rename("a.mcap", "b.mcap")
    assert file.read_bytes().startswith(before)
    names = [entry.recording for entry in History(tmp_path).recent_grasps]
    assert names == ["other.mcap", "2.mcap", "b.mcap", "0.mcap"]
