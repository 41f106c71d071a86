"""The catalogue: what readers see while files are added, joined and deleted."""

from __future__ import annotations

import threading
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pytest
from packages.archive.tests.drawn import DAYS, HOLDS, ROWS, draw_archive, palpate, read

from palpate.errors import InputError
from palpate_archive.adding import add_recordings
from palpate_archive.catalogue import Entry, list_files
from palpate_archive.compacting import join_files
from palpate_archive.layout import KINDS, Archive

pytestmark = pytest.mark.slow

TOTAL = 2 * len(DAYS) * 2 * HOLDS * ROWS


def entry(name: str, *sources: str) -> Entry:
    return Entry(
        file=f"holds/station=north/date=2026-05-01/{name}.parquet",
        rows=1,
        bytes=1,
        sha256=name,
        sources=sources,
    )


def test_writers_at_the_same_moment_lose_nothing(tmp_path: Path) -> None:
    """Two stations' timers under one name, each with files of its own and one in common."""
    archive = Archive(tmp_path / "a", create=True)

    def add(writer: int) -> None:
        for number in range(10):
            new = [entry(f"{writer}-{number}", f"{writer}-{number}"), entry(f"c{writer}", "common")]
            archive.catalogue("holds").add("north", new)

    threads = [threading.Thread(target=add, args=(writer,)) for writer in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    sources = [s for each in archive.catalogue("holds").files() for s in each.sources]
    assert len(sources) == len(set(sources)) == 31


def test_join_files_preserves_rows_and_sources(root: Path, recorded: Path) -> None:
    archive = Archive(root)
    before = {kind: pd.concat(read(root, kind).values()) for kind in KINDS[:2]}
    sources = {kind: archive.catalogue(kind).sources() for kind in KINDS}
    for kind in KINDS[:2]:
        assert join_files(archive, kind, grace_s=0.0) == (2, 1)
        assert join_files(archive, kind, grace_s=0.0) == (1, 1)
        [after] = read(root, kind).values()
        pd.testing.assert_frame_equal(after, before[kind].reset_index(drop=True))
        assert len(list((root / kind).rglob("*.parquet"))) == 1, "the pieces are gone"
    # Archived recordings are not added again.
    for station in ("north", "south"):
        assert list(add_recordings(archive, [recorded / "g2.mcap"], station=station)) == [{}]
    assert {kind: archive.catalogue(kind).sources() for kind in KINDS} == sources


def test_reader_sees_each_row_once_while_files_are_joined(tmp_path: Path) -> None:
    root = tmp_path / "a"
    draw_archive(root)
    counts, is_over = [], threading.Event()

    def query() -> None:
        with duckdb.connect() as database:
            while not is_over.is_set():
                files = list_files(root, "holds")
                rows = database.read_parquet(files, hive_partitioning=True).count("*").fetchall()
                counts.append(rows[0][0])

    reader = threading.Thread(target=query)
    reader.start()
    assert palpate("archive", "compact", str(root)) == 0
    while len(counts) < 5:
        pass
    is_over.set()
    reader.join()
    assert set(counts) == {TOTAL}


def test_query_that_began_before_compact_still_finds_its_files(tmp_path: Path) -> None:
    root = tmp_path / "a"
    draw_archive(root)
    files = list_files(root, "holds")
    assert palpate("archive", "compact", str(root)) == 0
    assert len(pd.read_parquet(files)) == TOTAL
    assert palpate("archive", "compact", str(root), "--grace", "0") == 0
    assert not any(Path(file).exists() for file in files)


def test_catalogue_opens_in_duckdb_pandas_and_polars(tmp_path: Path) -> None:
    root = tmp_path / "a"
    draw_archive(root)
    join_files(Archive(root), "holds", grace_s=3600.0)
    files = list_files(root, "holds")
    half = [("north", TOTAL // 2), ("south", TOTAL // 2)]
    frame = pd.read_parquet(files, partitioning="hive")
    assert list(frame.groupby("station", observed=True).size().items()) == half
    lazy = pl.scan_parquet(files, hive_partitioning=True)
    assert sorted(lazy.group_by("station").len().collect().rows()) == half
    found = duckdb.read_parquet(files, hive_partitioning=True)
    query = "select station, count(*) from found group by all order by all"
    assert duckdb.query_df(frame, "found", query).fetchall() == half
    assert found.count("*").fetchall() == [(TOTAL,)]


def test_list_files_without_the_kind_names_those_it_has(tmp_path: Path) -> None:
    draw_archive(tmp_path / "a")
    with pytest.raises(InputError, match="contains no frames; it contains holds"):
        list_files(tmp_path / "a", "frames")


def test_archive_of_another_schema_is_refused(tmp_path: Path) -> None:
    (tmp_path / "palpate-archive.json").write_text('{"schema": 1}')
    with pytest.raises(InputError, match="has schema 1"):
        Archive(tmp_path)


def test_draw_archive_is_seeded(tmp_path: Path) -> None:
    draw_archive(tmp_path / "a"), draw_archive(tmp_path / "b")
    one, two = (read(tmp_path / name, "holds") for name in "ab")
    assert all(np.array_equal(one[place]["value"], two[place]["value"]) for place in one)
