"""The files of an archive: ``KIND/station=NAME/date=DAY/PART.parquet``, and its catalogue.

Any reader of Hive partitions can open the files that the catalogue lists: DuckDB, pandas, Polars,
PyArrow, Spark. The sources of each file prevent duplicates.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from palpate.errors import InputError
from palpate_archive.catalogue import Catalogue, Entry
from palpate_archive.folders import Folder

#: Version of the columns and the catalogue; archives of other versions are refused.
SCHEMA = 2
KINDS = ("frames", "holds", "grasps")
#: Value of `date` for recordings in simulated time.
SIMULATED = "simulated"
#: Rows per row group, so that a query for a time range or a few holds reads few other rows.
ROWS_PER_GROUP = 50_000
_MARKER = "palpate-archive.json"
_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass(frozen=True, slots=True, kw_only=True, order=True)
class Part:
    """One file of an archive."""

    kind: str
    station: str
    #: ``YYYY-MM-DD`` in UTC, or ``simulated``.
    date: str
    #: File name without its extension.
    name: str

    @property
    def place(self) -> str:
        """Path relative to the root of the archive."""
        return f"{self.kind}/station={self.station}/date={self.date}/{self.name}.parquet"


class Archive:
    """An archive in a folder or a store.

    `root`: path or address. `create`: create the archive if it does not exist.
    `max_mbit`: largest mean rate of writing, megabits per second.
    Raises `InputError` if the folder is not an archive, or has another schema.
    """

    def __init__(
        self,
        root: str | os.PathLike[str],
        *,
        create: bool = False,
        max_mbit: float | None = None,
    ) -> None:
        self.folder = Folder.open(root, max_mbit=max_mbit)
        try:
            schema = self._open(create=create)
        except InputError:
            raise
        except (ValueError, KeyError, TypeError) as fault:
            raise InputError(
                f"{self.folder.name(_MARKER)}: can't be read; restore it from a backup"
            ) from fault
        if schema != SCHEMA:
            raise InputError(
                f"{root}: has schema {schema}, this version reads {SCHEMA}; add the recordings and "
                "stores to a new archive"
            )

    def _open(self, *, create: bool) -> Any:
        """Return the schema."""
        folder = self.folder
        if create and not folder.exists(_MARKER):
            if folder.exists() and any(folder.fs.ls(folder.path, detail=False)):
                raise InputError(
                    f"{folder.address}: contains other files; name a new or an empty folder"
                )
            with folder.replace(_MARKER) as partial:
                partial.write_text(json.dumps({"schema": SCHEMA}) + "\n")
        try:
            return json.loads(folder.read(_MARKER))["schema"]
        except FileNotFoundError:
            raise InputError(
                f"{folder.address}: not an archive; `palpate archive add` creates one"
            ) from None

    def catalogue(self, kind: str) -> Catalogue:
        """Return the catalogue of a kind."""
        return Catalogue(self.folder, kind)

    def parts(self, kind: str) -> list[Part]:
        """Return the files of a kind, in a fixed order."""
        return [parse_part(entry.file) for entry in self.catalogue(kind).files()]

    def write(self, part: Part, tables: Iterable[Any], *, sources: Sequence[str]) -> Entry:
        """Write a part atomically; return its entry, which is not yet in the catalogue.

        `tables`: tables of one schema, consumed one by one. `sources`: sources in the part.
        """
        return write_tables(self.folder, part.place, tables, sources=sources, marks={})


def parse_part(place: str) -> Part:
    """Return the part of a path relative to the root."""
    kind, station, date, name = place.split("/")
    return Part(
        kind=kind,
        station=station.removeprefix("station="),
        date=date.removeprefix("date="),
        name=name.removesuffix(".parquet"),
    )


def check_name(what: str, name: str) -> str:
    """Return a name that is valid in a folder name.

    Raises `InputError` for other names.
    """
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{what} {name!r}: use up to 64 letters, digits, dots, dashes, underscores"
        )
    return name


def write_tables(
    folder: Folder,
    place: str,
    tables: Iterable[Any],
    *,
    sources: Sequence[str],
    marks: dict[str, str],
) -> Entry:
    """Write tables of one schema to one Parquet file atomically; return its entry.

    `marks`: name -> text in the metadata of the file.
    """
    left: Iterator[Any] = iter(tables)
    first = next(left)
    schema = first.schema.with_metadata(marks)
    with folder.replace(place) as partial:
        with pa.parquet.ParquetWriter(partial, schema) as file:
            for table in chain((first,), left):
                file.write_table(table.cast(schema), row_group_size=ROWS_PER_GROUP)
        return describe_file(partial, place, sources=sources)


def describe_file(path: Path, place: str, *, sources: Sequence[str]) -> Entry:
    """Return the entry of a finished Parquet file."""
    with path.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    return Entry(
        file=place,
        rows=int(pa.parquet.read_metadata(path).num_rows),
        bytes=path.stat().st_size,
        sha256=digest,
        sources=tuple(sources),
    )
