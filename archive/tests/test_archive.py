"""Adding to an archive, reading it with other tools, and evaluating it."""

from __future__ import annotations

import shutil
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest
from archive.tests.archive_jobs import killing_job
from tests.pages import test_commands_of_page_run

from palpate.cli import build_app
from palpate.cli import run as run_command
from palpate.errors import PalpateError
from palpate.holds import read_holds
from palpate.produce.store.database import Store
from palpate.recording import load_recording
from palpate.recording.exporting import solve_resistance_ohm
from palpate_archive.adding import add_recordings, add_store
from palpate_archive.compacting import join_files
from palpate_archive.evaluating import (
    create_recalibrate_job,
    create_settle_job,
    delete_stale_results,
    perform,
    plan_tasks,
)
from palpate_archive.layout import KINDS, Archive

__all__ = ["test_commands_of_page_run"]
pytestmark = pytest.mark.slow


@pytest.fixture
def page() -> str:
    """The page's rig is calibrated for this file's recordings."""
    return "archive"


def palpate(*arguments: str) -> int:
    return run_command(build_app(), list(arguments), name="palpate")


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Record two simulated grasps, with a store."""
    folder = tmp_path_factory.mktemp("recorded")
    for number, seed in enumerate((0, 1), start=1):
        status = palpate(
            *("grasp", "--rig", "sim-rigid", "--rate-hz", "15"),
            *("--seed", str(seed), "--object", "strawberry"),
            *("--record", str(folder / f"g{number}.mcap"), "--item", f"berry-{number}"),
            *("--store", str(folder / "items.sqlite")),
        )
        assert status == 0
    return folder


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory, recorded: Path) -> Archive:
    """Return an archive of both recordings; one of them is given twice."""
    made = Archive(tmp_path_factory.mktemp("filled") / "archive", create=True)
    copy = made.root.parent / "copy.mcap"
    shutil.copy(recorded / "g1.mcap", copy)
    given = [recorded / "g1.mcap", copy, recorded / "g2.mcap"]
    first, repeated, second = add_recordings(made, given, station="north")
    assert min(first["frames"], second["frames"]) > 0
    assert repeated == {}, "recordings are identified by content"
    return made


@pytest.fixture
def archive(filled: Archive, tmp_path: Path) -> Archive:
    return Archive(shutil.copytree(filled.root, tmp_path / "archive"))


def ignore_progress(_: float) -> None:
    """Do nothing."""


def contents(root: Path) -> dict[str, pd.DataFrame]:
    return {
        str(path.relative_to(root)): pq.read_table(path, partitioning=None).to_pandas()
        for path in sorted(root.rglob("*.parquet"))
    }


def test_added_frames_match_recording(archive: Archive, recorded: Path) -> None:
    recording = load_recording(recorded / "g1.mcap")
    part = next(part for part in archive.parts("frames") if part.name.startswith("g1-"))
    assert (part.station, part.date) == ("north", "simulated")
    table = pq.read_table(archive.path(part), partitioning=None).to_pandas()
    assert set(table["origin"]) == {"twin"}
    assert table["time_s"].tolist() == recording.time_s.tolist()
    shape = recording.counts.shape
    assert np.array(table["counts"].tolist()).reshape(shape).tolist() == recording.counts.tolist()
    ohm = solve_resistance_ohm(recording).reshape(len(recording.time_s), -1)
    assert np.array_equal(np.array(table["ohm"].tolist()), ohm)


def test_add_store_adds_grasps_once(archive: Archive, recorded: Path) -> None:
    with Store.open(str(recorded / "items.sqlite")) as store:
        assert add_store(archive, store, station="north") == {"grasps": 2}
        assert add_store(archive, store, station="north") == {}
        taken = {grasp.grasp_id for grasp in store.grasps()}
    found = pd.read_parquet(archive.root / "grasps")
    assert set(found["grasp_id"]) == taken
    assert set(found["station"]) == {"north"}


def test_add_recordings_after_interruption_completes(archive: Archive, recorded: Path) -> None:
    """With holds but without frames, the recording is not yet added."""
    part = next(part for part in archive.parts("frames") if part.name.startswith("g1-"))
    archive.path(part).unlink()
    [added] = add_recordings(archive, [recorded / "g1.mcap"], station="north")
    assert added["frames"] > 0
    assert len(archive.parts("holds")) == len(archive.parts("frames")) == 2


def test_join_files_preserves_rows_and_sources(archive: Archive, recorded: Path) -> None:
    before = {kind: pd.concat(contents(archive.root / kind).values()) for kind in KINDS[:2]}
    sources = {kind: set(archive.sources(kind)) for kind in KINDS}
    for kind in KINDS[:2]:
        assert join_files(archive, kind) == (2, 1)
        assert join_files(archive, kind) == (1, 1)
        [after] = contents(archive.root / kind).values()
        pd.testing.assert_frame_equal(after, before[kind].reset_index(drop=True))
    # Archived recordings are not added again.
    for station in ("north", "south"):
        assert list(add_recordings(archive, [recorded / "g2.mcap"], station=station)) == [{}]
    assert {kind: set(archive.sources(kind)) for kind in KINDS} == sources


def test_join_files_after_interruption_completes(archive: Archive) -> None:
    """The joined part exists, and one of its pieces is not yet deleted."""
    piece = archive.parts("holds")[0]
    kept = archive.path(piece).read_bytes()
    join_files(archive, "holds")
    archive.path(piece).write_bytes(kept)
    assert join_files(archive, "holds") == (2, 1)
    assert len(archive.sources("holds")) == 2


def test_archive_opens_in_duckdb_pandas_and_polars(archive: Archive) -> None:
    files = f"{archive.root}/frames/**/*.parquet"
    query = f"select station, count(*) from read_parquet('{files}', hive_partitioning=true)"
    rows = sum(len(table) for table in contents(archive.root / "frames").values())
    assert duckdb.sql(f"{query} group by station").fetchall() == [("north", rows)]
    assert len(pd.read_parquet(archive.root / "frames")) == rows
    lazy = pl.scan_parquet(f"{archive.root}/frames/**/*.parquet", hive_partitioning=True)
    assert lazy.filter(pl.col("station") == "north").select(pl.len()).collect().item() == rows
    assert lazy.filter(pl.col("station") == "south").select(pl.len()).collect().item() == 0


def test_holds_part_is_readable_as_holds_file(archive: Archive) -> None:
    holds = list(read_holds(archive.path(archive.parts("holds")[0])))
    assert {hold.unit for hold in holds} == {"percent"}
    assert "mean" in {hold.channel for hold in holds}


def test_settle_job_results_are_reproducible_and_cached(archive: Archive, tmp_path: Path) -> None:
    job = create_settle_job(method="relaxation", horizon_s=5.0)
    one, two = (plan_tasks(job, archive, to=tmp_path / name) for name in ("one", "two"))
    assert perform(one, show=ignore_progress, workers=2) == sum(task.perform() for task in two) > 0
    assert all(task.is_done for task in one)
    for mine, other in zip(one, two, strict=True):
        assert mine.target.read_bytes() == other.target.read_bytes()
    [table, _] = contents(tmp_path / "one").values()
    known = {"ok", "unproven", "too_short", "misfit", "not_settling", "fell_back"}
    assert set(table["status"]) <= known
    other_job = create_settle_job(method="relaxation", horizon_s=6.0)
    assert not any(task.is_done for task in plan_tasks(other_job, archive, to=tmp_path / "one"))


def test_perform_with_killed_process_raises_and_second_run_completes(
    archive: Archive, tmp_path: Path
) -> None:
    tasks = plan_tasks(killing_job(tmp_path), archive, to=tmp_path / "out")
    with pytest.raises(PalpateError, match=r"died.*run it again"):
        perform(tasks, show=ignore_progress, workers=1)
    assert not list((tmp_path / "out").rglob("*.parquet"))
    assert perform(tasks, show=ignore_progress, workers=1) == sum(
        len(table) for table in contents(archive.root / "holds").values()
    )
    assert all(task.is_done for task in tasks)


def test_delete_stale_results_removes_results_of_joined_parts(
    archive: Archive, tmp_path: Path
) -> None:
    job = create_settle_job(method="relaxation", horizon_s=5.0)
    for task in plan_tasks(job, archive, to=tmp_path / "out"):
        task.perform()
    join_files(archive, "holds")
    after = plan_tasks(job, archive, to=tmp_path / "out")
    for task in after:
        task.perform()
    delete_stale_results(tmp_path / "out" / job.name, after)
    assert [task.target for task in after] == list((tmp_path / "out").rglob("*.parquet"))


def test_recalibrate_with_own_calibration_reproduces_force(
    archive: Archive, recorded: Path, tmp_path: Path
) -> None:
    recording = load_recording(recorded / "g1.mcap")
    assert recording.info.calibration is not None
    tasks = plan_tasks(
        create_recalibrate_job(recording.info.calibration), archive, to=tmp_path / "out"
    )
    for task in tasks:
        task.perform()
    table = contents(tmp_path / "out")
    [first] = [found for name, found in table.items() if "/g1-" in name]
    assert first["time_s"].tolist() == recording.time_s.tolist()
    assert (first["force_n_low"] <= first["force_n"]).all()
    # A gentle squeeze: a maximum of some newtons, and no force at the start.
    assert 1.0 < first["force_n"].max() < 6.0
    assert first["force_n"][:10].max() < 0.3


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
    ],
)
def test_archive_command_invalid_arguments_print_one_line(
    arguments: list[str],
    message: str,
    archive: Archive,
    recorded: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "diary.txt").write_text("dear")
    places = {"tmp": tmp_path, "archive": archive.root, "recorded": recorded}
    assert palpate("archive", *(each.format(**places) for each in arguments)) == 2
    [line] = capsys.readouterr().err.strip().splitlines()
    assert message in line
    assert not (tmp_path / "new").exists()
