"""Export of the store to Parquet, CSV or Excel: one row per grasp or per verdict."""

from __future__ import annotations

import csv
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

import sqlalchemy as sa

from palpate.errors import require_extra
from palpate.files import atomic_path, escape_csv_cell
from palpate.holds.table_files import import_pyarrow
from palpate_station.records import BIN_COLUMNS, MEASURED, About, Grasp, Item, Verdict
from palpate_station.store.schema import GRASPS, ITEMS, VERDICTS, UtcTime

_BATCH = 10_000
#: Columns of the export. Details are the last column, as JSON text; measurements are separate.
_ITEM_COLUMNS = tuple(c.name for c in ITEMS.c if c.name != "first_seen")
_GRASP_COLUMNS = tuple(c.name for c in GRASPS.c if c.name not in ("number", "item_id", "station"))
_VERDICT_COLUMNS = tuple(c.name for c in VERDICTS.c if c.name != "details")
_NO_BINS: Mapping[str, Verdict] = MappingProxyType({})

#: Extensions of the files that `export` writes.
FORMATS = (".parquet", ".csv", ".xlsx")


def export(
    path: Path,
    grasps: Iterable[Grasp],
    verdicts: Iterable[Verdict],
    *,
    items: Iterable[Item],
    bins: Mapping[str, Verdict],
) -> dict[str, str]:
    """Write grasps and verdicts; return each file with its numbers of rows.

    `path`: Parquet and CSV have the verdicts in a second file, ``NAME.verdicts.csv``, and Excel has
        them in a second sheet. Files are written atomically. CSV and Excel have lists and details
        as JSON text, times in ISO 8601, and no cell that runs as a formula.
    `bins`: bin of each grasp, from `find_bins`.
    Raises `MissingExtraError` if pyarrow (Parquet) or openpyxl (Excel) is not installed.
    """
    verdicts_path = path.with_suffix(f".verdicts{path.suffix}")
    if path.suffix == ".parquet":
        found = (
            export_grasps(path, grasps, items=items, bins=bins),
            export_verdicts(verdicts_path, verdicts),
        )
        return {str(path): f"grasps: {found[0]}", str(verdicts_path): f"verdicts: {found[1]}"}
    grasp_rows = _grasp_rows(grasps, items=items, bins=bins)
    if path.suffix == ".csv":
        found = (
            _write_csv(path, grasp_rows, _grasp_columns()),
            _write_csv(verdicts_path, _verdict_rows(verdicts), _verdict_columns()),
        )
        return {str(path): f"grasps: {found[0]}", str(verdicts_path): f"verdicts: {found[1]}"}
    with require_extra("--export FILE.xlsx", extra="tables", package="palpate-station"):
        from openpyxl import Workbook
    book = Workbook(write_only=True)
    counts = []
    for title, rows, names in (
        ("grasps", grasp_rows, _grasp_columns()),
        ("verdicts", _verdict_rows(verdicts), _verdict_columns()),
    ):
        sheet, count = book.create_sheet(title), 0
        sheet.append(names)
        for row in rows:
            sheet.append([_cell(row.get(name)) for name in names])
            count += 1
        counts.append(f"{title}: {count}")
    with atomic_path(path) as partial:
        book.save(partial)
    return {str(path): ", ".join(counts)}


def _write_csv(path: Path, rows: Iterable[dict[str, Any]], names: list[str]) -> int:
    count = 0
    with atomic_path(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(names)
        for row in rows:
            writer.writerow([_cell(row.get(name)) for name in names])
            count += 1
    return count


def _cell(value: object) -> object:
    """Return a value as a cell: a number, or text that is no formula."""
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, list | tuple):
        return json.dumps(value)
    return escape_csv_cell(value)


def find_bins(verdicts: Iterable[Verdict]) -> dict[str, Verdict]:
    """Return the last bin that was given for each grasp, by the grasp's ID."""
    bins = (one for one in verdicts if one.about is About.BIN and one.grasp_id is not None)
    return {str(one.grasp_id): one for one in sorted(bins, key=lambda one: one.given_at)}


def export_grasps(
    path: str | os.PathLike[str],
    grasps: Iterable[Grasp],
    *,
    items: Iterable[Item],
    bins: Mapping[str, Verdict] = _NO_BINS,
) -> int:
    """Write grasps with their items' fields to Parquet; return the number of rows.

    `path`: output file, written atomically.
    `grasps`: one row each, in this order. A measurement has four columns: its name for the value,
        and ``..._low``, ``..._high``, ``..._status``.
    `items`: items of the grasps.
    `bins`: bin of each grasp, from `find_bins`; five columns, empty for a grasp without one.
    Raises `MissingExtraError` if pyarrow is not installed.
    """
    return _write(path, _grasp_rows(grasps, items=items, bins=bins), _grasp_columns())


def export_verdicts(path: str | os.PathLike[str], verdicts: Iterable[Verdict]) -> int:
    """Write verdicts with details as JSON text to Parquet; return the number of rows.

    Raises `MissingExtraError` if pyarrow is not installed.
    """
    return _write(path, _verdict_rows(verdicts), _verdict_columns())


def _grasp_rows(
    grasps: Iterable[Grasp], *, items: Iterable[Item], bins: Mapping[str, Verdict]
) -> Iterator[dict[str, Any]]:
    known = {item.item_id: item for item in items}
    for grasp in grasps:
        row = grasp_row(grasp, known.get(grasp.item_id)) | {"station": grasp.station}
        if (given := bins.get(grasp.grasp_id)) is not None:
            provisional = given.details.get("provisional")
            row |= zip(
                BIN_COLUMNS,
                (given.text, given.explanation, given.probability, provisional, given.giver),
                strict=True,
            )
        yield row


def _verdict_rows(verdicts: Iterable[Verdict]) -> Iterator[dict[str, Any]]:
    for verdict in verdicts:
        row = {name: getattr(verdict, name) for name in _VERDICT_COLUMNS}
        row |= {"about": str(verdict.about), "source": str(verdict.source)}
        yield row | {"details": json.dumps(dict(verdict.details))}


def _grasp_columns() -> list[str]:
    return [*_grasp_names(), "station", *BIN_COLUMNS]


def _verdict_columns() -> list[str]:
    return [*_VERDICT_COLUMNS, "details"]


def require_parquet() -> Any:
    """Return pyarrow with its Parquet module.

    Raises `MissingExtraError` if pyarrow is not installed.
    """
    return import_pyarrow("Parquet (unlike --json)")


def grasp_schema() -> Any:
    """Return the Arrow schema of grasps."""
    return _schema(_grasp_names())


def _grasp_names() -> list[str]:
    measured = [f"{name}{end}" for name in MEASURED for end in ("", "_low", "_high", "_status")]
    return [*_ITEM_COLUMNS, *_GRASP_COLUMNS, *measured]


def grasp_row(grasp: Grasp, item: Item | None) -> dict[str, Any]:
    """Return the columns of a grasp and its item."""
    row = {name: getattr(item, name, None) for name in _ITEM_COLUMNS}
    row |= {name: getattr(grasp, name) for name in _GRASP_COLUMNS}
    row |= {"item_id": grasp.item_id, "outcome": str(grasp.outcome)}
    for name, measured in grasp.measurements.items():
        low, high = measured.known_ends
        row |= {name: measured.value, f"{name}_low": low, f"{name}_high": high}
        row[f"{name}_status"] = str(measured.status)
    return row


def _write(path: str | os.PathLike[str], rows: Iterable[dict[str, Any]], names: list[str]) -> int:
    arrow, schema = require_parquet(), _schema(names)
    remaining = iter(rows)
    written = 0
    with atomic_path(Path(path)) as partial, arrow.parquet.ParquetWriter(partial, schema) as file:
        while batch := list(islice(remaining, _BATCH)):
            file.write_table(arrow.Table.from_pylist(batch, schema=schema))
            written += len(batch)
    return written


def _schema(names: Sequence[str]) -> Any:
    arrow = require_parquet()
    return arrow.schema([(name, _column_type(name, arrow)) for name in names])


def _column_type(column: str, arrow: Any) -> Any:
    """Return the Arrow type for a column of the tables or a measurement."""
    table = next((one for one in (ITEMS, GRASPS, VERDICTS) if column in one.c), None)
    sql_type = None if table is None else table.c[column].type
    if column == "bin_provisional":
        return arrow.bool_()
    if column in BIN_COLUMNS and column != "bin_probability":
        return arrow.string()
    if column == "pixel_settled_percent":
        return arrow.list_(arrow.list_(arrow.float64()))
    if column.endswith("_status") or isinstance(sql_type, sa.Text | sa.JSON):
        return arrow.string()
    if isinstance(sql_type, UtcTime):
        return arrow.timestamp("us", tz="UTC")
    return arrow.float64()
