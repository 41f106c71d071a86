"""Outbox of the local store: records and messages for a receiver, in order.

A row is written in the same transaction as its record, and removed after the receiver's
acknowledgement. Delivery is therefore at least once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import sqlalchemy as sa

from palpate_station.records import Item
from palpate_station.store.reading import read_grasps, read_items, read_verdicts
from palpate_station.store.schema import CALIBRATIONS, GRASPS, ITEMS, OUTBOX, VERDICTS
from palpate_station.store.writing import (
    write_calibration,
    write_grasps,
    write_items,
    write_verdict,
)

#: Receiver of records, the shared store; other receivers get messages.
SHARED = "shared"


def enqueue(connection: sa.Connection, receiver: str, rows: Iterable[tuple[str, str]]) -> None:
    """Add rows of (kind, content) to the outbox."""
    values = [{"receiver": receiver, "kind": kind, "content": text} for kind, text in rows]
    if values:
        connection.execute(OUTBOX.insert(), values)


def read_waiting(connection: sa.Connection, receiver: str, *, limit: int) -> Sequence[Any]:
    """Return a receiver's oldest rows: number, kind and content."""
    query = sa.select(OUTBOX).where(OUTBOX.c.receiver == receiver)
    return connection.execute(query.order_by(OUTBOX.c.number).limit(limit)).all()


def count_waiting(connection: sa.Connection, receiver: str) -> int:
    """Return the number of a receiver's rows."""
    query = sa.select(sa.func.count()).select_from(OUTBOX)
    return int(connection.scalar(query.where(OUTBOX.c.receiver == receiver)) or 0)


def remove(connection: sa.Connection, numbers: Sequence[int]) -> None:
    """Remove acknowledged rows."""
    connection.execute(OUTBOX.delete().where(OUTBOX.c.number.in_(numbers)))


def remove_oldest(connection: sa.Connection, receiver: str, *, most: int) -> int:
    """Keep a receiver's newest `most` rows; return the number removed."""
    numbers = sa.select(OUTBOX.c.number).where(OUTBOX.c.receiver == receiver)
    last = numbers.order_by(OUTBOX.c.number.desc()).limit(1).offset(most).scalar_subquery()
    surplus = OUTBOX.delete().where(OUTBOX.c.receiver == receiver, OUTBOX.c.number <= last)
    return connection.execute(surplus).rowcount


def item_kind(item: Item) -> str:
    """Return the outbox kind of an item, with the names of its non-empty columns."""
    return " ".join(["item", *(n for n in ("kind", "batch", "label") if getattr(item, n))])


def copy_record(source: sa.Connection, target: sa.Connection, kind: str, content: str) -> None:
    """Copy a record and all records that it refers to.

    `kind`: ``item`` with the columns to copy, ``grasp`` or ``verdict``.
    `content`: the ID of the record.
    """
    record_type, *columns = kind.split()
    if record_type == "item":
        for item in read_items(source, sa.select(ITEMS).where(ITEMS.c.item_id == content)):
            values = {name: getattr(item, name) for name in columns}
            write_items(target, [Item(item_id=item.item_id, first_seen=item.first_seen, **values)])
    elif record_type == "grasp":
        grasp_query = sa.select(GRASPS).where(GRASPS.c.grasp_id == content)
        for grasp in read_grasps(source, grasp_query).values():
            if grasp.calibration_id is not None:
                query = sa.select(CALIBRATIONS.c.content).where(
                    CALIBRATIONS.c.calibration_id == grasp.calibration_id
                )
                write_calibration(target, source.scalars(query).one())
            write_grasps(target, [grasp])
    else:
        verdict_query = sa.select(VERDICTS).where(VERDICTS.c.verdict_id == content)
        for verdict in read_verdicts(source, verdict_query):
            copy_record(source, target, "item", verdict.item_id)
            if verdict.grasp_id is not None:
                copy_record(source, target, "grasp", verdict.grasp_id)
            write_verdict(target, verdict)
