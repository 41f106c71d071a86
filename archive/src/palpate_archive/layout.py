"""The folders and files of an archive: ``KIND/station=NAME/date=DAY/PART.parquet``.

Any reader of Hive partitions can open an archive: DuckDB, pandas, Polars, PyArrow, Spark. The
Parquet metadata of each part lists its sources, which prevents duplicates.
"""

from __future__ import annotations

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
from palpate.files import atomic_path

#: Version of the columns; archives of other versions are refused.
SCHEMA = 1
KINDS = ("frames", "holds", "grasps")
#: Value of `date` for recordings in simulated time.
SIMULATED = "simulated"
#: Rows per row group, so that a query for a time range or a few holds reads few other rows.
ROWS_PER_GROUP = 50_000
_MARKER, _SOURCES = "palpate-archive.json", b"palpate.sources"
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
    def place(self) -> Path:
        """Path relative to the root of the archive."""
        folder = Path(self.kind) / f"station={self.station}" / f"date={self.date}"
        return folder / f"{self.name}.parquet"


class Archive:
    """An archive in a folder.

    `create`: create the archive if it does not exist.
    Raises `InputError` if the folder is not an archive, or has another schema.
    """

    def __init__(self, root: str | os.PathLike[str], *, create: bool = False) -> None:
        self.root = Path(root)
        marker = self.root / _MARKER
        if create and not marker.exists():
            if self.root.is_dir() and any(self.root.iterdir()):
                raise InputError(f"{root}: contains other files; name a new or an empty folder")
            self.root.mkdir(parents=True, exist_ok=True)
            with atomic_path(marker) as partial:
                partial.write_text(json.dumps({"schema": SCHEMA}) + "\n")
        try:
            schema = json.loads(marker.read_text())["schema"]
        except FileNotFoundError:
            raise InputError(f"{root}: not an archive; `palpate archive add` creates one") from None
        except (ValueError, KeyError, TypeError) as fault:
            raise InputError(f"{marker}: can't be read; restore it from a backup") from fault
        if schema != SCHEMA:
            raise InputError(
                f"{root}: has schema {schema}, this version reads {SCHEMA}; update palpate"
            )

    def parts(self, kind: str) -> list[Part]:
        """Return the files of a kind, in a fixed order."""
        found = (self.root / kind).glob("station=*/date=*/[!.]*.parquet")
        return sorted(parse_part(path.relative_to(self.root)) for path in found)

    def path(self, part: Part) -> Path:
        """Return the file of a part."""
        return self.root / part.place

    def sources(self, kind: str) -> dict[str, Part]:
        """Return source -> part that contains it."""
        return {name: part for part in self.parts(kind) for name in sources_of(self.path(part))}

    def write(self, part: Part, tables: Iterable[Any], *, sources: Sequence[str]) -> int:
        """Write a part atomically; return the number of rows.

        `tables`: tables of one schema, consumed one by one. `sources`: sources in the part.
        """
        return write_tables(self.path(part), tables, marks={_SOURCES: json.dumps(list(sources))})


def parse_part(place: Path) -> Part:
    """Return the part of a path relative to the root."""
    kind, station, date, name = place.parts
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


def sources_of(path: Path) -> list[str]:
    """Return the sources of a part.

    Raises `InputError` if the file is not a part of an archive.
    """
    try:
        marks = pa.parquet.read_schema(path).metadata or {}
        return [str(name) for name in json.loads(marks[_SOURCES])]
    except (KeyError, ValueError) as fault:
        raise InputError(f"{path}: not a part of an archive; move it elsewhere") from fault


def write_tables(path: Path, tables: Iterable[Any], *, marks: dict[bytes, str]) -> int:
    """Write tables of one schema to one Parquet file atomically; return the row count."""
    parquet, rows = pa.parquet, 0
    path.parent.mkdir(parents=True, exist_ok=True)
    left: Iterator[Any] = iter(tables)
    first = next(left)
    schema = first.schema.with_metadata({name: text.encode() for name, text in marks.items()})
    with atomic_path(path) as partial, parquet.ParquetWriter(partial, schema) as file:
        for table in chain((first,), left):
            file.write_table(table.cast(schema), row_group_size=ROWS_PER_GROUP)
            rows += table.num_rows
    return rows
