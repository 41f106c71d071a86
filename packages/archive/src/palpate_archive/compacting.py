"""Join the small files of each day into few files with the same rows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import groupby

from palpate_archive.catalogue import Catalogue, Entry
from palpate_archive.folders import Folder
from palpate_archive.layout import write_tables

#: Largest number of rows of a joined file, which one worker can hold in memory.
MOST_ROWS = 1_000_000


def join_files(archive: Folder, kind: str, *, grace_s: float) -> tuple[int, int]:
    """Join the files of each day; return the numbers of files before and after.

    A joined file is complete before the catalogue lists it instead of its pieces. The pieces stay
    for `grace_s` seconds, for readers of the catalogue before; a later call deletes them.
    """
    catalogue = Catalogue(archive, kind)
    before = catalogue.files()
    for _, day in groupby(before, key=lambda entry: entry.part[:3]):
        for pieces in _batches(day):
            # Another command may delete pieces meanwhile; the next call joins the others.
            with suppress(FileNotFoundError):
                if len(pieces) > 1:
                    _join(catalogue, pieces)
    for station in catalogue.stations():
        catalogue.expire(station, grace_s=grace_s)
    return len(before), len(catalogue.files())


def _batches(entries: Iterable[Entry]) -> Iterator[list[Entry]]:
    """Yield groups of files to join, in order, up to a row limit."""
    batch, rows = list[Entry](), 0
    for entry in entries:
        if batch and rows + entry.rows > MOST_ROWS:
            yield batch
            batch, rows = [], 0
        batch.append(entry)
        rows += entry.rows
    yield batch


def _join(catalogue: Catalogue, pieces: Sequence[Entry]) -> None:
    folder, first = catalogue.folder, pieces[0].part
    name = hashlib.sha256("\n".join(entry.sha256 for entry in pieces).encode()).hexdigest()[:12]
    joined = write_tables(
        folder,
        first._replace(name=f"joined-{name}").place,
        (folder.read_table(entry.file) for entry in pieces),
        sources=[source for entry in pieces for source in entry.sources],
    )

    def decide(before: list[Entry]) -> list[Entry]:
        # Another writer may have joined or deleted pieces meanwhile.
        if not set(pieces) <= set(before):
            return before
        return [*(entry for entry in before if entry not in pieces), joined]

    if joined not in catalogue.change(first.station, decide)[1]:
        folder.delete([joined.file])
