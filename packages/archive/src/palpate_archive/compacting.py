"""Join the small files of each day into few files with the same rows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import pyarrow.parquet

from palpate_archive.catalogue import Entry
from palpate_archive.layout import Archive, Part, parse_part

#: Largest number of rows of a joined file, which one worker can hold in memory.
MOST_ROWS = 1_000_000


def join_files(archive: Archive, kind: str, *, grace_s: float) -> tuple[int, int]:
    """Join the files of each day; return the numbers of files before and after.

    A joined file is complete before the catalogue lists it instead of its pieces. The pieces stay
    for `grace_s` seconds, for readers of the catalogue before; a later call deletes them.
    """
    catalogue = archive.catalogue(kind)
    before = catalogue.entries()
    for station, entries in before.items():
        for _, day in groupby(entries, key=lambda entry: entry.date):
            for pieces in _batches(day):
                _join(archive, station, pieces)
        catalogue.expire(station, grace_s=grace_s)
    return sum(map(len, before.values())), len(catalogue.files())


def _batches(entries: Iterator[Entry]) -> Iterator[list[Entry]]:
    """Yield groups of files to join, in order, up to a row limit."""
    batch, rows = list[Entry](), 0
    for entry in entries:
        if batch and rows + entry.rows > MOST_ROWS:
            if len(batch) > 1:
                yield batch
            batch, rows = [], 0
        batch.append(entry)
        rows += entry.rows
    if len(batch) > 1:
        yield batch


def _join(archive: Archive, station: str, pieces: Sequence[Entry]) -> None:
    first = parse_part(pieces[0].file)
    sources = [name for entry in pieces for name in entry.sources]
    name = hashlib.sha256("\n".join(entry.sha256 for entry in pieces).encode()).hexdigest()[:12]
    part = Part(kind=first.kind, station=station, date=first.date, name=f"joined-{name}")
    joined = archive.write(part, _tables(archive, pieces), sources=sources)

    def decide(before: list[Entry]) -> list[Entry] | None:
        # Another writer may have joined or deleted pieces meanwhile.
        if not set(pieces) <= set(before):
            return None
        return [*(entry for entry in before if entry not in pieces), joined]

    catalogue = archive.catalogue(first.kind)
    if not catalogue.change(station, decide) and joined not in catalogue.files():
        archive.folder.delete([joined.file])


def _tables(archive: Archive, pieces: Sequence[Entry]) -> Iterator[Any]:
    for entry in pieces:
        with archive.folder.fetch(entry.file) as path:
            yield pyarrow.parquet.read_table(path, partitioning=None)
