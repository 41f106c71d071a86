"""Writing of records in the caller's transaction, without changes to existing rows."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import asdict, fields
from datetime import UTC, datetime
from itertools import islice
from math import isfinite

import sqlalchemy as sa

from palpate_station.records import Grasp, Item, Verdict
from palpate_station.store.schema import (
    CALIBRATIONS,
    GRASPS,
    ITEMS,
    MEASUREMENTS,
    VERDICTS,
    insert,
)

#: Maximum number of grasps per statement, because databases limit the number of parameters.
_CHUNK = 1000
_GRASP_COLUMNS = tuple(f.name for f in fields(Grasp) if f.name != "measurements")


def write_items(connection: sa.Connection, items: Iterable[Item]) -> None:
    """Add items or update their fields; `first_seen` changes only to an earlier time."""
    statement = insert(ITEMS, dialect=connection.dialect.name)
    new = statement.excluded
    known = {n: sa.func.coalesce(new[n], ITEMS.c[n]) for n in ("kind", "batch", "label")}
    is_earlier = new.first_seen < ITEMS.c.first_seen
    first_seen = sa.case((is_earlier, new.first_seen), else_=ITEMS.c.first_seen)
    connection.execute(
        statement.on_conflict_do_update(
            index_elements=[ITEMS.c.item_id], set_={**known, "first_seen": first_seen}
        ),
        [asdict(item) | {"first_seen": item.first_seen or datetime.now(UTC)} for item in items],
    )


def calibration_id_of(text: str) -> str:
    """Return the ID of a calibration, equal for equal text.

    >>> calibration_id_of("{}")
    '44136fa355b3678a'
    """
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write_calibration(connection: sa.Connection, text: str) -> str:
    """Store the text of a calibration; return its ID."""
    calibration_id = calibration_id_of(text)
    statement = insert(CALIBRATIONS, dialect=connection.dialect.name)
    connection.execute(
        statement.values(calibration_id=calibration_id, content=text).on_conflict_do_nothing()
    )
    return calibration_id


def write_grasps(connection: sa.Connection, grasps: Iterable[Grasp]) -> list[str]:
    """Add grasps with their items and measurements; return the IDs of new grasps."""
    remaining = iter(grasps)
    added: list[str] = []
    # The dictionary removes duplicates.
    while chunk := {grasp.grasp_id: grasp for grasp in islice(remaining, _CHUNK)}:
        first_seen: dict[str, datetime] = {}
        for grasp in chunk.values():
            earliest = first_seen.get(grasp.item_id, grasp.taken_at)
            first_seen[grasp.item_id] = min(earliest, grasp.taken_at)
        # Sorted, so that concurrent writers cannot deadlock.
        items = (Item(item_id=n, first_seen=time) for n, time in sorted(first_seen.items()))
        write_items(connection, items)
        statement = insert(GRASPS, dialect=connection.dialect.name).on_conflict_do_nothing(
            index_elements=[GRASPS.c.grasp_id]
        )
        rows = [
            {name: getattr(grasp, name) for name in _GRASP_COLUMNS}
            | {"outcome": str(grasp.outcome)}
            for grasp in chunk.values()
        ]
        # The statement returns only inserted rows.
        found = connection.execute(statement.returning(GRASPS.c.grasp_id, GRASPS.c.number), rows)
        numbers = {row.grasp_id: row.number for row in found}
        measured = [
            {
                "grasp_number": number,
                "name": name,
                "value": None if one.value is None else float(one.value),
                "low": float(one.low) if isfinite(one.low) else None,
                "high": float(one.high) if isfinite(one.high) else None,
                "level": float(one.level),
                "status": str(one.status),
            }
            for grasp_id, number in numbers.items()
            for name, one in chunk[grasp_id].measurements.items()
        ]
        if measured:
            connection.execute(MEASUREMENTS.insert(), measured)
        added += [grasp_id for grasp_id in chunk if grasp_id in numbers]
    return added


def write_verdict(connection: sa.Connection, verdict: Verdict) -> bool:
    """Add a verdict; False if already stored."""
    row = {f.name: getattr(verdict, f.name) for f in fields(Verdict)}
    row |= {
        "about": str(verdict.about),
        "source": str(verdict.source),
        "details": dict(verdict.details),
    }
    statement = insert(VERDICTS, dialect=connection.dialect.name).values(row)
    found = connection.execute(
        statement.on_conflict_do_nothing(index_elements=[VERDICTS.c.verdict_id]).returning(
            VERDICTS.c.verdict_id
        )
    )
    return found.first() is not None
