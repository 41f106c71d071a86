"""The folder of an archive, and how its Parquet files are written.

Any reader of Hive partitions can open the files that the catalogue lists: DuckDB, pandas, Polars,
PyArrow, Spark. The sources of each file prevent duplicates.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from palpate.errors import InputError
from palpate_archive.catalogue import Entry
from palpate_archive.folders import Folder

#: Version of the columns and the catalogue; archives of other versions are refused.
SCHEMA = 2
KINDS = ("frames", "holds", "grasps")
#: Date of recordings in simulated time.
SIMULATED = "simulated"
#: Rows per row group, so that a query for a time range or a few holds reads few other rows.
ROWS_PER_GROUP = 50_000
_MARKER = "palpate-archive.json"
_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")
#: Name of the list of sources in the metadata of a Parquet file.
_SOURCES = "palpate.sources"


def open_archive(
    root: str | os.PathLike[str], *, create: bool = False, max_mbit: float | None = None
) -> Folder:
    """Return the folder of an archive at a path or address.

    `create`: create the archive if it does not exist.
    `max_mbit`: largest mean rate of writing, megabits per second.
    Raises `InputError` if the folder is not an archive, or has another schema.
    """
    folder = Folder.open(root, max_mbit=max_mbit)
    if create and not folder.fs.exists(_MARKER):
        if folder.fs.exists("") and folder.fs.ls("", detail=False):
            raise InputError(f"{root}: contains other files; name a new or an empty folder")
        with folder.replace(_MARKER) as partial:
            partial.write_text(json.dumps({"schema": SCHEMA}) + "\n")
    try:
        schema = json.loads(folder.fs.cat_file(_MARKER))["schema"]
    except FileNotFoundError:
        raise InputError(f"{root}: not an archive; `palpate archive add` creates one") from None
    except (ValueError, KeyError, TypeError) as fault:
        raise InputError(
            f"{folder.name(_MARKER)}: can't be read; restore it from a backup"
        ) from fault
    if schema != SCHEMA:
        raise InputError(
            f"{root}: has schema {schema}, this version reads {SCHEMA}; add the recordings and "
            "stores to a new archive"
        )
    return folder


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
    marks: Mapping[str, str] | None = None,
) -> Entry:
    """Write a Parquet file atomically; return its entry, which is not yet in the catalogue.

    `tables`: tables of one schema, consumed one by one. `sources`: sources of their rows.
    `marks`: name -> text in the metadata of the file, with the sources.
    """
    left = iter(tables)
    first = next(left)
    schema = first.schema.with_metadata({_SOURCES: json.dumps(list(sources))} | dict(marks or {}))
    with folder.replace(place) as partial:
        with pa.parquet.ParquetWriter(partial, schema) as file:
            for table in chain((first,), left):
                file.write_table(table.cast(schema), row_group_size=ROWS_PER_GROUP)
        return describe_file(partial, place)


def describe_file(path: Path, place: str) -> Entry:
    """Return the entry of a finished Parquet file."""
    found = pa.parquet.read_metadata(path)
    sources = json.loads(found.metadata[_SOURCES.encode()])
    return Entry(place, int(found.num_rows), hash_file(path), tuple(sources))


def read_metadata(folder: Folder, place: str) -> dict[str, Any]:
    """Return name -> value of the JSON texts that palpate wrote in a file's metadata."""
    with folder.fs.open(place) as file:
        found = pa.parquet.read_metadata(file).metadata or {}
    names = (name for name in found if name.startswith(b"palpate."))
    return {name.decode(): json.loads(found[name]) for name in names}


def read_sources(folder: Folder, place: str) -> set[str]:
    """Return the sources of the rows of a file, without reading them."""
    return set(read_metadata(folder, place).get(_SOURCES, ()))


def hash_file(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
