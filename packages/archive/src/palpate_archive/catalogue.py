"""The catalogue of an archive: which files count, for each kind and station.

A version of the catalogue is one Parquet file, ``catalogue/KIND/station=NAME/00000042.parquet``;
the newest counts. A writer creates the next version, which fails if another writer was faster; it
then starts from that version. So a change of several files, such as joining them, happens at once
for every reader, and no change is lost. Files that a version no longer lists stay for readers that
started before, until `expire` deletes them.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields
from itertools import pairwise
from pathlib import PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from palpate.errors import InputError
from palpate_archive.folders import Folder

_PLACE = "catalogue"


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One file of Parquet rows, or sources that were deleted and are not added again."""

    #: ``KIND/station=NAME/date=DAY/PART.parquet``; empty for deleted sources.
    file: str
    rows: int
    bytes: int
    #: Digest of the file.
    sha256: str
    #: Digests of the recordings, or identifiers of the grasps, in the file.
    sources: tuple[str, ...]

    @property
    def date(self) -> str:
        """Day of the file, or ``simulated``."""
        return PurePosixPath(self.file).parent.name.removeprefix("date=")


_SCHEMA = pa.schema(
    [
        ("file", pa.string()),
        ("rows", pa.int64()),
        ("bytes", pa.int64()),
        ("sha256", pa.string()),
        ("sources", pa.list_(pa.string())),
    ]
)
#: Takes the entries of the newest version; returns those of the next, or None for no change.
Change = Callable[[list[Entry]], list[Entry] | None]


class Catalogue:
    """The files of one kind, or of one job's results."""

    def __init__(self, folder: Folder, kind: str) -> None:
        self.folder = folder
        self.kind = kind

    def stations(self) -> dict[str, list[Entry]]:
        """Return station -> entries of its newest version, with those of deleted sources."""
        while True:
            newest = {station: names[-1] for station, names in self._versions().items()}
            try:
                read = self.folder.read_all(newest.values())
            except FileNotFoundError:
                # A newer version replaced it between the listing and the reading.
                continue
            return {station: _parse(read[place]) for station, place in newest.items()}

    def entries(self) -> dict[str, list[Entry]]:
        """Return station -> files, in the order of their names."""
        return {
            station: sorted((e for e in entries if e.file), key=lambda entry: entry.file)
            for station, entries in sorted(self.stations().items())
        }

    def files(self) -> list[Entry]:
        """Return the files of all stations."""
        return [entry for entries in self.entries().values() for entry in entries]

    def sources(self) -> set[str]:
        """Return the sources in the files, and those that were deleted."""
        return {s for entries in self.stations().values() for e in entries for s in e.sources}

    def change(self, station: str, decide: Change) -> bool:
        """Write the next version for a station; return whether there was a change.

        `decide` is called again if another writer was faster.
        """
        while True:
            names = self._versions(station).get(station, [])
            before = _parse(self.folder.read(names[-1])) if names else []
            after = decide(before)
            if after is None or after == before:
                return False
            number = int(PurePosixPath(names[-1]).stem) + 1 if names else 1
            place = f"{_PLACE}/{self.kind}/station={station}/{number:08}.parquet"
            try:
                self.folder.create(place, _format(after))
            except FileExistsError:
                continue
            return True

    def add(self, station: str, entries: Iterable[Entry]) -> None:
        """Add files, except those with a source that is already in the catalogue."""
        given = list(entries)

        def decide(before: list[Entry]) -> list[Entry]:
            held = {source for entry in before for source in entry.sources}
            return [*before, *(entry for entry in given if held.isdisjoint(entry.sources))]

        self.change(station, decide)

    def put(self, station: str, entries: Iterable[Entry]) -> None:
        """List these files alone."""
        given = list(entries)
        self.change(station, lambda _: given)

    def expire(self, station: str, *, grace_s: float) -> None:
        """Delete the files that no version lists which was the newest in the last `grace_s`."""
        names = self._versions(station).get(station, [])
        old = [
            name
            for name, following in pairwise(names)
            if grace_s <= 0 or self.folder.age_s(following) > grace_s
        ]
        if not old:
            return
        read = {place: _parse(text) for place, text in self.folder.read_all(names).items()}
        kept = {entry.file for name in names if name not in old for entry in read[name]}
        gone = {entry.file for name in old for entry in read[name]} - kept - {""}
        # The versions last: an interrupted call leaves a list of what is to be deleted.
        self.folder.delete(sorted(gone))
        self.folder.delete(old)

    def _versions(self, station: str | None = None) -> dict[str, list[str]]:
        """Return station -> places of its versions, the oldest first."""
        below = f"{_PLACE}/{self.kind}" + ("" if station is None else f"/station={station}")
        found: dict[str, list[str]] = {}
        for place in self.folder.find(below):
            name = PurePosixPath(place).parent.name.removeprefix("station=")
            found.setdefault(name, []).append(place)
        return found


def list_kinds(folder: Folder) -> list[str]:
    """Return the kinds with a catalogue in a folder."""
    return sorted({place.split("/")[1] for place in folder.find(_PLACE)})


def list_files(address: str | os.PathLike[str], kind: str) -> list[str]:
    """Return the files of an archive or of results, for a reader of Hive partitions.

    `address`: folder or address of an archive, or of the results of its evaluation.
    `kind`: ``frames``, ``holds`` or ``grasps``, or the name of a job such as ``settle-relaxation``.
    The files are those of one moment, each row in one of them; they exist for an hour longer.
    Raises `InputError` if there are none.
    """
    folder = Folder.open(address)
    if found := [folder.name(entry.file) for entry in Catalogue(folder, kind).files()]:
        return found
    known = ", ".join(list_kinds(folder)) or "nothing"
    raise InputError(f"{address}: contains no {kind}; it contains {known}")


def _format(entries: Iterable[Entry]) -> bytes:
    names = [one.name for one in fields(Entry)]
    rows = [{name: getattr(entry, name) for name in names} for entry in entries]
    sink = io.BytesIO()
    pa.parquet.write_table(pa.Table.from_pylist(rows, schema=_SCHEMA), sink)
    return sink.getvalue()


def _parse(content: bytes) -> list[Entry]:
    # With threads, PyArrow may release the bytes after the end of Python, which aborts.
    table = pa.parquet.read_table(io.BytesIO(content), use_threads=False)
    rows: list[dict[str, Any]] = table.to_pylist()
    return [Entry(**row | {"sources": tuple(row["sources"])}) for row in rows]
