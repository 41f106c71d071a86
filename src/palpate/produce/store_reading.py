"""Rows to records."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from palpate.estimate.measurement import Measurement
from palpate.produce.records import MEASURED, Grasp, Item, Reading, Verdict
from palpate.produce.store_schema import GRASPS, ITEMS, MEASUREMENTS, VERDICTS
from palpate.produce.store_sql import sa
from palpate.settling.result import Status

_READING_COLUMNS = tuple(f.name for f in fields(Reading) if f.name != "measurement")
#: Numbers in one IN list: below SQLite's bound on parameters in every build.
_MOST_NUMBERS = 500


def read_items(connection: sa.Connection, query: sa.Select[Any]) -> tuple[Item, ...]:
    """Return the items that a query over `ITEMS` finds."""
    return tuple(Item(**row) for row in connection.execute(query).mappings())


def read_grasps(connection: sa.Connection, query: sa.Select[Any]) -> tuple[Grasp, ...]:
    """Return the grasps that a query over `GRASPS` finds, with their measurements."""
    rows = [dict(row) for row in connection.execute(query).mappings()]
    numbers = [row.pop("number") for row in rows]
    measured = _measurements(connection, numbers)
    return tuple(
        Grasp(**_grasp_values(row), measurements=measured.get(number, {}))
        for number, row in zip(numbers, rows, strict=True)
    )


def read_history(connection: sa.Connection, item_id: str, name: str) -> tuple[Reading, ...]:
    """Return one measurement of an item over its grasps, oldest first."""
    query = (
        sa.select(*(GRASPS.c[column] for column in _READING_COLUMNS), MEASUREMENTS)
        .join(MEASUREMENTS, MEASUREMENTS.c.grasp_number == GRASPS.c.number)
        .where(GRASPS.c.item_id == item_id, MEASUREMENTS.c.name == name)
        .order_by(GRASPS.c.taken_at, GRASPS.c.number)
    )
    return tuple(
        Reading(measurement=_measurement(row), **{c: row[c] for c in _READING_COLUMNS})
        for row in connection.execute(query).mappings()
    )


def read_verdicts(connection: sa.Connection, query: sa.Select[Any]) -> tuple[Verdict, ...]:
    """Return the verdicts that a query over `VERDICTS` finds."""
    return tuple(Verdict(**row) for row in connection.execute(query).mappings())


def narrowed(
    query: sa.Select[Any], *, kind: str | None = None, batch: str | None = None
) -> sa.Select[Any]:
    """Keep the rows of items of one kind, of one batch."""
    if kind is not None:
        query = query.where(ITEMS.c.kind == kind)
    if batch is not None:
        query = query.where(ITEMS.c.batch == batch)
    return query


def verdict_query() -> sa.Select[Any]:
    """Return a query over all verdicts, oldest first."""
    return sa.select(VERDICTS).order_by(VERDICTS.c.given_at, VERDICTS.c.verdict_id)


def _measurements(
    connection: sa.Connection, numbers: Sequence[int]
) -> dict[int, dict[str, Measurement]]:
    found: dict[int, dict[str, Measurement]] = {}
    for start in range(0, len(numbers), _MOST_NUMBERS):
        wanted = MEASUREMENTS.c.grasp_number.in_(numbers[start : start + _MOST_NUMBERS])
        query = sa.select(MEASUREMENTS).where(wanted)
        for row in connection.execute(query).mappings():
            found.setdefault(row["grasp_number"], {})[row["name"]] = _measurement(row)
    return found


def _measurement(row: sa.RowMapping) -> Measurement:
    return Measurement(
        value=row["value"],
        low=row["low"],
        high=row["high"],
        unit=MEASURED[row["name"]],
        level=row["level"],
        status=Status(row["status"]),
    )


def _grasp_values(row: dict[str, Any]) -> dict[str, Any]:
    pixels = row["pixel_settled_percent"]
    # JSON has lists where a record has tuples.
    return row if pixels is None else row | {"pixel_settled_percent": tuple(map(tuple, pixels))}
