"""Records to rows, in a transaction of the caller's; what is there already is left alone."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields
from datetime import UTC, datetime
from itertools import islice
from typing import Any

from palpate.produce.records import Grasp, Item, Verdict
from palpate.produce.store.engine import sa
from palpate.produce.store.schema import (
    CALIBRATIONS,
    GRASPS,
    ITEMS,
    MEASUREMENTS,
    VERDICTS,
    insert,
)

#: Grasps of one statement: more gain little, and databases bound the number of parameters.
_CHUNK = 1000
_GRASP_COLUMNS = tuple(f.name for f in fields(Grasp) if f.name != "measurements")


def write_item(connection: sa.Connection, item: Item) -> None:
    """Add an item, or fill in what is newly known of it."""
    statement = insert(ITEMS, dialect=connection.dialect.name)
    new = statement.excluded
    given = {name: getattr(item, name) for name in ("kind", "batch", "label")}
    statement = statement.values(
        item_id=item.item_id, first_seen=item.first_seen or datetime.now(UTC), **given
    ).on_conflict_do_update(
        index_elements=[ITEMS.c.item_id],
        set_={
            **{name: sa.func.coalesce(new[name], ITEMS.c[name]) for name in given},
            "first_seen": sa.case(
                (new.first_seen < ITEMS.c.first_seen, new.first_seen), else_=ITEMS.c.first_seen
            ),
        },
    )
    connection.execute(statement)


def calibration_id_of(text: str) -> str:
    """Return the id of a calibration: the same for the same text.

    >>> calibration_id_of("{}")
    '44136fa355b3678a'
    """
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def write_calibration(connection: sa.Connection, text: str) -> str:
    """Keep the text of a calibration; return its id."""
    calibration_id = calibration_id_of(text)
    statement = insert(CALIBRATIONS, dialect=connection.dialect.name)
    connection.execute(
        statement.values(calibration_id=calibration_id, content=text).on_conflict_do_nothing()
    )
    return calibration_id


def write_grasps(connection: sa.Connection, grasps: Iterable[Grasp]) -> list[str]:
    """Add grasps with their items and measurements; return the ids of those that were new."""
    left = iter(grasps)
    added: list[str] = []
    while chunk := list(islice(left, _CHUNK)):
        _know_items(connection, chunk)
        statement = insert(GRASPS, dialect=connection.dialect.name).on_conflict_do_nothing(
            index_elements=[GRASPS.c.grasp_id]
        )
        # Only rows that were put in come back.
        found = connection.execute(
            statement.returning(GRASPS.c.grasp_id, GRASPS.c.number), [_row(g) for g in chunk]
        )
        numbers = {row.grasp_id: row.number for row in found}
        measured = list(_measurement_rows(chunk, numbers))
        if measured:
            connection.execute(MEASUREMENTS.insert(), measured)
        ids = dict.fromkeys(grasp.grasp_id for grasp in chunk)
        added += [grasp_id for grasp_id in ids if grasp_id in numbers]
    return added


def write_verdict(connection: sa.Connection, verdict: Verdict) -> bool:
    """Add a verdict; False if it was there already."""
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


def _know_items(connection: sa.Connection, grasps: Sequence[Grasp]) -> None:
    """Add the items that are new; none is first seen later than its first grasp."""
    first_seen: dict[str, datetime] = {}
    for grasp in grasps:
        met = first_seen.setdefault(grasp.item_id, grasp.taken_at)
        first_seen[grasp.item_id] = min(met, grasp.taken_at)
    statement = insert(ITEMS, dialect=connection.dialect.name)
    statement = statement.on_conflict_do_update(
        index_elements=[ITEMS.c.item_id],
        set_={"first_seen": statement.excluded.first_seen},
        where=statement.excluded.first_seen < ITEMS.c.first_seen,
    )
    # In one order, so that two writers never wait for each other.
    rows = [{"item_id": name, "first_seen": time} for name, time in sorted(first_seen.items())]
    connection.execute(statement, rows)


def _row(grasp: Grasp) -> dict[str, Any]:
    row = {name: getattr(grasp, name) for name in _GRASP_COLUMNS}
    return row | {"outcome": str(grasp.outcome)}


def _measurement_rows(
    grasps: Sequence[Grasp], numbers: Mapping[str, int]
) -> Iterable[dict[str, Any]]:
    unwritten = dict(numbers)
    for grasp in grasps:
        # The same grasp twice in one call is one grasp.
        number = unwritten.pop(grasp.grasp_id, None)
        if number is None:
            continue
        for name, measured in grasp.measurements.items():
            yield {
                "grasp_number": number,
                "name": name,
                "value": float(measured.middle),
                "low": float(measured.low),
                "high": float(measured.high),
                "level": float(measured.level),
                "status": str(measured.status),
            }
