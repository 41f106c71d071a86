"""Export of the store to Parquet: one row per grasp or per verdict."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import sqlalchemy as sa

from palpate.files import atomic_path
from palpate.holds.table_files import import_pyarrow
from palpate_station.records import MEASURED, Grasp, Item, Verdict
from palpate_station.store.schema import GRASPS, ITEMS, VERDICTS, UtcTime

_BATCH = 10_000
#: Columns of the export. Details are the last column, as JSON text; measurements are separate.
_ITEM_COLUMNS = tuple(c.name for c in ITEMS.c if c.name != "first_seen")
_GRASP_COLUMNS = tuple(c.name for c in GRASPS.c if c.name not in ("number", "item_id"))
_VERDICT_COLUMNS = tuple(c.name for c in VERDICTS.c if c.name != "details")


def export_grasps(
    path: str | os.PathLike[str], grasps: Iterable[Grasp], *, items: Iterable[Item]
) -> int:
    """Write grasps with their items' fields; return the number of rows.

    `path`: output file, written atomically.
    `grasps`: one row each, in this order. A measurement has four columns: its name for the value,
        and ``..._low``, ``..._high``, ``..._status``.
    `items`: items of the grasps.
    Raises `MissingExtraError` if pyarrow is not installed.
    """
    known = {item.item_id: item for item in items}
    return _write(path, (grasp_row(g, known.get(g.item_id)) for g in grasps), _grasp_names())


def export_verdicts(path: str | os.PathLike[str], verdicts: Iterable[Verdict]) -> int:
    """Write verdicts with details as JSON text; return the number of rows.

    Raises `MissingExtraError` if pyarrow is not installed.
    """
    rows = (
        {name: getattr(verdict, name) for name in _VERDICT_COLUMNS}
        | {"about": str(verdict.about), "source": str(verdict.source)}
        | {"details": json.dumps(dict(verdict.details))}
        for verdict in verdicts
    )
    return _write(path, rows, [*_VERDICT_COLUMNS, "details"])


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
        row |= {name: measured.value, f"{name}_low": measured.low, f"{name}_high": measured.high}
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
    if column == "pixel_settled_percent":
        return arrow.list_(arrow.list_(arrow.float64()))
    if column.endswith("_status") or isinstance(sql_type, sa.Text | sa.JSON):
        return arrow.string()
    if isinstance(sql_type, UtcTime):
        return arrow.timestamp("us", tz="UTC")
    return arrow.float64()
