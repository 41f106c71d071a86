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
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from itertools import pairwise
from pathlib import PurePosixPath
from typing import NamedTuple

import pyarrow as pa
import pyarrow.parquet

from palpate.errors import InputError
from palpate_archive.folders import Folder

#: Seconds for which files stay after a change, for running queries.
GRACE_S = 3600.0
#: Folder of the catalogue.
CATALOGUE = "catalogue"


class Part(NamedTuple):
    """What the place of a file says: ``KIND/station=NAME/date=DAY/NAME.parquet``."""

    #: ``frames``, ``holds`` or ``grasps``, or the name of a job.
    kind: str
    station: str
    #: ``YYYY-MM-DD`` in UTC, or ``simulated``.
    date: str
    name: str

    @property
    def place(self) -> str:
        """Path relative to the archive."""
        return f"{self.kind}/station={self.station}/date={self.date}/{self.name}.parquet"

    @classmethod
    def parse(cls, place: str) -> Part:
        """Return the part at a place."""
        kind, station, date, file = place.split("/")
        name = file.removesuffix(".parquet")
        return cls(kind, station.removeprefix("station="), date.removeprefix("date="), name)


class Entry(NamedTuple):
    """One file of Parquet rows, or sources that were deleted and are not added again."""

    #: Place of the file; empty for deleted sources.
    file: str
    rows: int
    #: Digest of the file.
    sha256: str
    #: Digests of the recordings, or identifiers of the grasps, in the file.
    sources: tuple[str, ...]

    @property
    def part(self) -> Part:
        """What the place says."""
        return Part.parse(self.file)


_SCHEMA = pa.schema(
    {
        "file": pa.string(),
        "rows": pa.int64(),
        "sha256": pa.string(),
        "sources": pa.list_(pa.string()),
    }
)
#: Takes the entries of the newest version; returns those of the next.
Change = Callable[[list[Entry]], list[Entry]]


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
                read = self._read(newest.values())
            except FileNotFoundError:
                # A newer version replaced it between the listing and the reading.
                continue
            return {station: read[place] for station, place in newest.items()}

    def files(self) -> list[Entry]:
        """Return the files of all stations, in the order of their names."""
        return sorted(e for entries in self.stations().values() for e in entries if e.file)

    def sources(self, *, deleted: bool | None = None) -> set[str]:
        """Return the sources in the files and those that were deleted, or one of both."""
        return {
            source
            for entries in self.stations().values()
            for entry in entries
            if deleted in (None, not entry.file)
            for source in entry.sources
        }

    def change(self, station: str, decide: Change) -> tuple[list[Entry], list[Entry]]:
        """Write the next version for a station; return the entries before and after.

        `decide` is called again if another writer was faster. If it returns the entries as they
        are, there is no new version.
        """
        while True:
            names = self._versions(station).get(station, [])
            before = self._read(names[-1:])[names[-1]] if names else []
            if (after := decide(before)) == before:
                return before, before
            number = int(PurePosixPath(names[-1]).stem) + 1 if names else 1
            place = f"{CATALOGUE}/{self.kind}/station={station}/{number:08}.parquet"
            content = io.BytesIO()
            rows = [entry._asdict() for entry in after]
            pa.parquet.write_table(pa.Table.from_pylist(rows, schema=_SCHEMA), content)
            try:
                self.folder.create(place, content.getvalue())
            except FileExistsError:
                continue
            self.expire(station)
            return before, after

    def add(self, entries: Iterable[Entry]) -> None:
        """Add files, except those with a source that is already in the station's catalogue.

        Files with a source that was deleted meanwhile are deleted.
        """
        new = defaultdict[str, list[Entry]](list)
        for entry in entries:
            new[entry.part.station].append(entry)
        for station, given in new.items():

            def decide(before: list[Entry], given: list[Entry] = given) -> list[Entry]:
                held = {source: entry.file for entry in before for source in entry.sources}
                after = list(before)
                for entry in given:
                    found = {held.get(source) for source in entry.sources}
                    if found == {None}:
                        after.append(entry)
                        held |= dict.fromkeys(entry.sources, entry.file)
                    elif "" in found:
                        self.folder.delete([entry.file])
                return after

            self.change(station, decide)

    def expire(self, station: str, *, grace_s: float = GRACE_S) -> None:
        """Delete the files that no version lists which was the newest in the last `grace_s`."""
        names = self._versions(station).get(station, [])
        old = [
            name
            for name, following in pairwise(names)
            if time.time() - self.folder.fs.modified(following).timestamp() >= grace_s
        ]
        if old:
            read = self._read(names)
            kept = {entry.file for name in names if name not in old for entry in read[name]}
            gone = {entry.file for name in old for entry in read[name]} - kept - {""}
            # The versions last, as they say what is to be deleted.
            self.folder.delete([*sorted(gone), *old])

    def _versions(self, station: str | None = None) -> dict[str, list[str]]:
        """Return station -> places of its versions, the oldest first."""
        below = f"{CATALOGUE}/{self.kind}" + ("" if station is None else f"/station={station}")
        found = defaultdict[str, list[str]](list)
        for place in self.folder.find(below):
            found[PurePosixPath(place).parent.name.removeprefix("station=")].append(place)
        return found

    def _read(self, places: Iterable[str]) -> dict[str, list[Entry]]:
        """Return place -> entries of versions, fetched at the same time where the store can."""
        found = {}
        # fsspec raises an error for no file.
        contents = self.folder.fs.cat(given, recursive=False) if (given := list(places)) else {}
        for place, content in contents.items():
            # With threads, PyArrow may release the bytes after the end of Python, which aborts.
            file = pa.parquet.ParquetFile(io.BytesIO(content))
            table = file.read(columns=_SCHEMA.names, use_threads=False)
            rows = table.to_pylist()
            found[place] = [Entry(**row | {"sources": tuple(row["sources"])}) for row in rows]
        return found


def list_kinds(folder: Folder) -> list[str]:
    """Return the kinds with a catalogue in a folder."""
    return sorted({place.split("/")[1] for place in folder.find(CATALOGUE)})


def list_files(address: str | os.PathLike[str], kind: str) -> list[str]:
    """Return the files of an archive or of results, for a reader of Hive partitions.

    `address`: folder or address of an archive, or of the results of its evaluation.
    `kind`: ``frames``, ``holds`` or ``grasps``, or the name of a job such as ``settle-relaxation``.
    The files are those of one moment, each row in one of them; they exist for an hour longer,
    unless their rows are deleted.
    Raises `InputError` if there are none.
    """
    folder = Folder.open(address)
    if found := [folder.name(entry.file) for entry in Catalogue(folder, kind).files()]:
        return found
    known = ", ".join(list_kinds(folder)) or "nothing"
    raise InputError(f"{address}: contains no {kind}; it contains {known}")
