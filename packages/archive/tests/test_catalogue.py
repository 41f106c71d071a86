"""The catalogue: what readers see while files are added, joined and deleted."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from packages.archive.tests.drawn import DAYS, HOLDS, ROWS, draw_archive, palpate, read

from palpate.errors import InputError
from palpate_archive.adding import add_recordings
from palpate_archive.catalogue import Catalogue, Entry, Part, list_files
from palpate_archive.compacting import join_files
from palpate_archive.folders import Folder
from palpate_archive.forgetting import Selection, forget
from palpate_archive.layout import KINDS, open_archive, write_tables

pytestmark = pytest.mark.slow

TOTAL = 2 * len(DAYS) * 2 * HOLDS * ROWS


def entry(name: str, *sources: str) -> Entry:
    return Entry(
        file=f"holds/station=north/date=2026-05-01/{name}.parquet",
        rows=1,
        sha256=name,
        sources=sources,
    )


def test_writers_at_the_same_moment_lose_nothing(tmp_path: Path) -> None:
    """Two stations' timers under one name, each with files of its own and one in common."""
    catalogue = Catalogue(open_archive(tmp_path / "a", create=True), "holds")

    def add(writer: int) -> None:
        for number in range(10):
            new = [entry(f"{writer}-{number}", f"{writer}-{number}"), entry(f"c{writer}", "common")]
            catalogue.add(new)

    threads = [threading.Thread(target=add, args=(writer,)) for writer in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    sources = [s for each in catalogue.files() for s in each.sources]
    assert len(sources) == len(set(sources)) == 31


def test_join_files_preserves_rows_and_sources(root: Path, recorded: Path) -> None:
    archive = open_archive(root)
    before = {kind: pd.concat(read(root, kind).values()) for kind in KINDS[:2]}
    sources = {kind: Catalogue(archive, kind).sources() for kind in KINDS}
    for kind in KINDS[:2]:
        assert join_files(archive, kind, grace_s=0.0) == (2, 1)
        assert join_files(archive, kind, grace_s=0.0) == (1, 1)
        [after] = read(root, kind).values()
        pd.testing.assert_frame_equal(after, before[kind].reset_index(drop=True))
        assert len(list((root / kind).rglob("*.parquet"))) == 1, "the pieces are gone"
    # Archived recordings are not added again.
    for station in ("north", "south"):
        assert list(add_recordings(archive, [recorded / "g2.mcap"], station=station)) == [{}]
    assert {kind: Catalogue(archive, kind).sources() for kind in KINDS} == sources


def count_rows(root: Path) -> dict[str, int]:
    """Return station -> rows of holds, as DuckDB counts them in the files of one moment."""
    with duckdb.connect() as database:
        found = database.read_parquet(list_files(root, "holds"), hive_partitioning=True)
        return dict(found.aggregate("station, count(*)", "station").fetchall())


@contextmanager
def reading(root: Path) -> Iterator[list[dict[str, int]]]:
    """Count rows in a loop beside the block; yield the counts, at least three."""
    counts, is_over = [count_rows(root)], threading.Event()

    def query() -> None:
        while not is_over.is_set() or len(counts) < 3:
            counts.append(count_rows(root))

    with ThreadPoolExecutor(1) as pool:
        reader = pool.submit(query)
        yield counts
        is_over.set()
        reader.result()


def test_reader_sees_each_row_once_while_files_are_joined(tmp_path: Path) -> None:
    root = tmp_path / "a"
    draw_archive(root)
    with reading(root) as counts:
        assert palpate("archive", "compact", str(root)) == 0
    half = TOTAL // 2
    assert all(found == {"north": half, "south": half} for found in counts)


def write_file(archive: Folder, station: str, number: int) -> Entry:
    """Write a row without entering it, as a running `add` does."""
    source = f"{station}{number:03}".ljust(12, "0")
    table = pa.table({"recording": [f"r-{source}"], "value": [1.0]})
    place = Part("holds", station, DAYS[number % 2], f"r-{source}").place
    return write_tables(archive, place, [table], sources=[source])


@pytest.mark.parametrize(
    ("selected", "rows"),
    [
        (["--station", "north"], 0),
        (["--day", DAYS[0]], 0),
        (["--day", DAYS[1]], 1),
        (["--item", "A17"], 1),
    ],
)
def test_forget_between_writing_and_entering_a_file(
    selected: list[str], rows: int, tmp_path: Path
) -> None:
    """Selected rows are gone, others are there once; no listed file is missing."""
    archive = open_archive(tmp_path / "a", create=True)
    catalogue = Catalogue(archive, "holds")
    catalogue.add([write_file(archive, "west", 1)])
    new = write_file(archive, "north", 0)
    assert palpate("archive", "forget", str(tmp_path / "a"), *selected) == 0
    catalogue.add([new])
    west = 0 if DAYS[1] in selected else 1
    found = [entry.part.station for entry in catalogue.files()]
    assert (found.count("north"), found.count("west")) == (rows, west)
    assert archive.find("holds") == [entry.file for entry in catalogue.files()]
    # Another call with the same recording, for example after an interruption.
    catalogue.add([write_file(archive, "north", 0)])
    assert archive.find("holds") == [entry.file for entry in catalogue.files()]


def test_add_compact_and_forget_at_the_same_time(tmp_path: Path) -> None:
    """A station that nobody forgets keeps each of its rows, for every query."""
    root, files = tmp_path / "a", 24
    archive = open_archive(root, create=True)
    catalogue = Catalogue(archive, "holds")
    catalogue.add([write_file(archive, station, 0) for station in ("north", "south")])

    def add(station: str) -> None:
        for number in range(1, files, 2):
            new = [write_file(archive, station, each) for each in (number, number + 1)]
            catalogue.add(new)

    def forget_north() -> None:
        for _ in range(6):
            forget(archive, Selection(station="north"), results=[])

    def join() -> None:
        for _ in range(6):
            join_files(archive, "holds", grace_s=3600.0)

    with ThreadPoolExecutor(4) as pool:
        running = [pool.submit(add, "north"), pool.submit(add, "south")]
        running += [pool.submit(forget_north), pool.submit(join)]
        south = list[int]()
        while not all(each.done() for each in running):
            listed = [file for file in list_files(root, "holds") if "station=south" in file]
            south.append(duckdb.read_parquet(listed).count("*").fetchall()[0][0])
        for each in running:
            each.result()
    assert south == sorted(south)
    assert set(south) <= set(range(1, files + 2, 2))
    forget(archive, Selection(station="north"), results=[])
    assert count_rows(root) == {"south": files + 1}
    assert not archive.find("holds/station=north")


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
    join_files(open_archive(root), "holds", grace_s=3600.0)
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
        open_archive(tmp_path)


def test_draw_archive_is_seeded(tmp_path: Path) -> None:
    draw_archive(tmp_path / "a"), draw_archive(tmp_path / "b")
    one, two = (read(tmp_path / name, "holds") for name in "ab")
    assert all(np.array_equal(one[place]["value"], two[place]["value"]) for place in one)
