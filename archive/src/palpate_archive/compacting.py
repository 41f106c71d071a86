"""Join the small parts of each day into few files with the same rows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from palpate_archive.layout import Archive, Part, sources_of

#: Largest number of rows of a joined part, which one worker can hold in memory.
MOST_ROWS = 1_000_000


def join_files(archive: Archive, kind: str) -> tuple[int, int]:
    """Join the parts of each day; return the numbers of parts before and after.

    The joined part is complete before its pieces are deleted. After an interruption in between,
    both exist until the next call, which deletes the pieces first.
    """
    before = archive.parts(kind)
    for _, day in groupby(before, key=lambda part: (part.station, part.date)):
        left = _delete_joined_pieces(archive, list(day))
        for pieces in _batches(archive, left):
            _join(archive, pieces)
    return len(before), len(archive.parts(kind))


def _delete_joined_pieces(archive: Archive, parts: Sequence[Part]) -> list[Part]:
    """Delete parts whose sources are all in a larger part; return the others."""
    held = {part: set(sources_of(archive.path(part))) for part in parts}
    left = []
    for part in parts:
        if any(held[part] < held[other] for other in parts):
            archive.path(part).unlink()
        else:
            left.append(part)
    return left


def _batches(archive: Archive, parts: Sequence[Part]) -> Iterator[list[Part]]:
    """Yield groups of parts to join, in order, up to a row limit."""
    batch, rows = list[Part](), 0
    for part in parts:
        count = int(pa.parquet.read_metadata(archive.path(part)).num_rows)
        if batch and rows + count > MOST_ROWS:
            if len(batch) > 1:
                yield batch
            batch, rows = [], 0
        batch.append(part)
        rows += count
    if len(batch) > 1:
        yield batch


def _join(archive: Archive, pieces: Sequence[Part]) -> None:
    sources = [name for part in pieces for name in sources_of(archive.path(part))]
    name = hashlib.sha256("\n".join(sources).encode()).hexdigest()[:12]
    first = pieces[0]
    joined = Part(kind=first.kind, station=first.station, date=first.date, name=f"joined-{name}")
    archive.write(joined, _tables(archive, pieces), sources=sources)
    for part in pieces:
        archive.path(part).unlink()


def _tables(archive: Archive, pieces: Sequence[Part]) -> Iterator[Any]:
    for part in pieces:
        yield pa.parquet.read_table(archive.path(part), partitioning=None)
