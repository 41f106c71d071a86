"""The commands of `palpate archive`: their page, wrong arguments, comparing and forgetting."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from packages.archive.tests.drawn import HOLDS, ROWS, draw_archive, palpate, read
from tests.pages import test_commands_of_page_run

from palpate_archive import evaluating
from palpate_archive.adding import add_store
from palpate_archive.catalogue import Catalogue, list_files
from palpate_archive.evaluating import enter_results, plan_tasks
from palpate_archive.folders import Folder
from palpate_archive.jobs import create_settle_job
from palpate_archive.layout import KINDS, open_archive

__all__ = ["test_commands_of_page_run"]

pytestmark = pytest.mark.slow

JOB = "settle-log_law"


@pytest.fixture
def page() -> str:
    return "archive"


def settle(archive: Folder, to: Path, *, horizon_s: float = 10.0) -> None:
    """Evaluate in a plain loop."""
    job, folder = create_settle_job(method="log_law", horizon_s=horizon_s), Folder.open(to)
    entries = [task.perform() for task in plan_tasks(job, archive, to=folder)]
    enter_results(Catalogue(folder, job.name), entries, of=Catalogue(archive, "holds"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["settle", "{tmp}/none"], "none: not an archive; `palpate archive add` creates one"),
        (["add", "--to", "{tmp}/new"], "nothing to add"),
        (["add", "{recorded}/g1.mcap", "--to", "{tmp}/other"], "contains other files"),
        (["add", "{tmp}/none.mcap", "--to", "{tmp}/new"], "none.mcap: no such file or folder"),
        (["settle", "{archive}", "--horizon", "2"], "--horizon 2: give at least 5 s"),
        (["recalibrate", "{archive}", "--calibration", "{tmp}/none.json"], "none.json"),
        (["add", "{recorded}/g1.mcap", "--to", "{tmp}/new", "--station", "a/b"], "--station 'a/b'"),
        (["add", "{recorded}", "--to", "{tmp}/new", "--max-mbit", "0"], "--max-mbit 0"),
        (["settle", "unheard://of"], "unheard"),
        (["forget", "{archive}"], "nothing selected"),
        (["forget", "{archive}", "--day", "May"], "--day May"),
        (["compare", "{archive}", "{tmp}"], "no job in common"),
        (["settle", "{archive}", "--scheduler", "here"], "--scheduler here"),
    ],
)
def test_archive_command_invalid_arguments_print_one_line(
    arguments: list[str],
    message: str,
    root: Path,
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "diary.txt").write_text("dear")
    places = {"tmp": tmp_path, "archive": root, "recorded": recorded}
    assert palpate("archive", *(each.format(**places) for each in arguments)) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert message in line
    assert not (tmp_path / "new").exists()


def test_bucket_without_access_prints_one_line(
    bucket: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert palpate("archive", "settle", f"{bucket}-not-there/archive") == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert "not an archive" in line


def test_compare_counts_what_changed_by_station_and_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second version has another horizon, and a day less of one station."""
    archive = draw_archive(tmp_path / "a")
    settle(archive, tmp_path / "r1")
    assert palpate("archive", "forget", archive.address, "--station", "south",
                   "--day", "2026-05-02") == 0  # fmt: skip
    newer = evaluating.code_versions() | {"palpate": "9.9"}
    monkeypatch.setattr(evaluating, "code_versions", lambda: newer)
    settle(archive, tmp_path / "r2", horizon_s=14.0)
    capsys.readouterr()
    assert palpate("archive", "compare", str(tmp_path / "r1"), str(tmp_path / "r2"), "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert [code["palpate"] for code in found["code"]["b"]] == ["9.9"]
    rows = 2 * HOLDS * 3
    days = {(day["station"], day["day"]): day for day in found["days"]}
    assert [(day["both"], day["only_a"], day["only_b"]) for day in days.values()] == [
        (rows, 0, 0),
        (rows, 0, 0),
        (rows, 0, 0),
        (0, rows, 0),
    ]
    first = days["north", "2026-05-01"]
    assert first["changed"] == rows
    assert 0 < first["median_percent"] <= first["largest_percent"] < 20
    assert palpate("archive", "compare", str(tmp_path / "r1"), str(tmp_path / "r1"), "--json") == 0
    same = json.loads(capsys.readouterr().out)["days"]
    assert {(day["changed"], day["outside"], day["median_percent"]) for day in same} == {
        (0, 0, None)
    }


@pytest.mark.parametrize(
    ("selected", "left"),
    [
        (["--station", "north"], {("south", "2026-05-01"), ("south", "2026-05-02")}),
        (["--day", "2026-05-01"], {("north", "2026-05-02"), ("south", "2026-05-02")}),
        (["--station", "north", "--day", "2026-05-01"],
         {("north", "2026-05-02"), ("south", "2026-05-01"), ("south", "2026-05-02")}),
        (["--keep-days", "0"], set()),
    ],
)  # fmt: skip
def test_forget_deletes_station_and_day_from_files_and_results(
    selected: list[str], left: set[tuple[str, str]], tmp_path: Path
) -> None:
    root = tmp_path / "a"
    archive = draw_archive(root)
    settle(archive, root / "results")
    settle(archive, tmp_path / "elsewhere")
    # A result that was written but not entered, because the evaluation was interrupted.
    settle(archive, root / "results", horizon_s=12.0)
    results = ["--results", str(tmp_path / "elsewhere")]
    assert palpate("archive", "forget", str(root), *selected, *results) == 0
    for folder in (root / "holds", root / "results" / JOB, tmp_path / "elsewhere" / JOB):
        found = {path.parts[-3:-1] for path in folder.rglob("*.parquet")}
        assert found == {(f"station={station}", f"date={day}") for station, day in left}
    entries = Catalogue(archive, "holds").files()
    assert sum(entry.rows for entry in entries) == len(left) * 2 * HOLDS * ROWS
    # The station still has its recordings; they are not added again.
    assert len(Catalogue(archive, "holds").sources()) == 8


def test_forget_item_deletes_its_grasps_and_their_recordings(
    root: Path, recorded: Path, tmp_path: Path
) -> None:
    from palpate_station.store.database import Store

    archive = open_archive(root)
    with Store.open(str(recorded / "items.sqlite")) as store:
        add_store(archive, store, station="north")
        assert palpate("archive", "compact", str(root), "--grace", "0") == 0
        settle(archive, root / "results")
        assert palpate("archive", "forget", str(root), "--item", "berry-1") == 0
        for kind in KINDS[:2]:
            [table] = read(root, kind).values()
            assert {label.split("-")[0] for label in table["recording"]} == {"g2"}
        [grasps] = read(root, "grasps").values()
        assert set(grasps["item_id"]) == {"berry-2"}
        assert not list((root / "results" / JOB).rglob("*.parquet"))
        for kind in KINDS:
            assert len(list((root / kind).rglob("*.parquet"))) == 1
        # Nothing comes back, and what is left can be evaluated.
        assert add_store(archive, store, station="north") == {}
    add = ("archive", "add", str(recorded), "--to", str(root), "--station", "north")
    assert palpate(*add) == 0
    assert [len(table) for table in read(root, "frames").values()] == [
        entry.rows for entry in Catalogue(archive, "frames").files()
    ]
    assert len(list_files(root, "frames")) == 1
    settle(archive, root / "results")
    [table] = read(root / "results", JOB).values()
    assert {label.split("-")[0] for label in table["recording"]} == {"g2"}
