"""Records and messages that wait in the local store for a receiver, in order.

A row is written in the transaction of the record itself and removed once the receiver has
acknowledged it, so each arrives at least once.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from palpate.produce.records import Item
from palpate.produce.store.engine import sa
from palpate.produce.store.reading import read_grasps, read_items, read_verdicts
from palpate.produce.store.schema import CALIBRATIONS, GRASPS, ITEMS, OUTBOX, VERDICTS
from palpate.produce.store.writing import (
    write_calibration,
    write_grasps,
    write_items,
    write_verdict,
)

#: The receiver of records; other receivers take messages.
SHARED = "shared"


def enqueue(connection: sa.Connection, receiver: str, rows: Iterable[tuple[str, str]]) -> None:
    """Add rows of (kind, content) to the outbox."""
    values = [{"receiver": receiver, "kind": kind, "content": text} for kind, text in rows]
    if values:
        connection.execute(OUTBOX.insert(), values)


def read_waiting(connection: sa.Connection, receiver: str, *, limit: int) -> Sequence[Any]:
    """Return the rows that have waited longest: number, kind and content."""
    query = sa.select(OUTBOX).where(OUTBOX.c.receiver == receiver)
    return connection.execute(query.order_by(OUTBOX.c.number).limit(limit)).all()


def remove(connection: sa.Connection, numbers: Sequence[int]) -> None:
    """Remove rows that have arrived."""
    connection.execute(OUTBOX.delete().where(OUTBOX.c.number.in_(numbers)))


def drop_oldest(connection: sa.Connection, receiver: str, *, most: int) -> int:
    """Remove a receiver's rows beyond the newest `most`; return their number."""
    numbers = sa.select(OUTBOX.c.number).where(OUTBOX.c.receiver == receiver)
    last = numbers.order_by(OUTBOX.c.number.desc()).limit(1).offset(most).scalar_subquery()
    surplus = OUTBOX.delete().where(OUTBOX.c.receiver == receiver, OUTBOX.c.number <= last)
    return connection.execute(surplus).rowcount


def item_kind(item: Item) -> str:
    """Return the record type of an item's row, with its filled columns."""
    return " ".join(["item", *(n for n in ("kind", "batch", "label") if getattr(item, n))])


def copy_record(source: sa.Connection, target: sa.Connection, kind: str, content: str) -> None:
    """Copy a record with all that it refers to from one database to the other.

    `kind`: ``item`` with the columns to copy, ``grasp`` or ``verdict``.
    `content`: the id of the record.
    """
    what, *columns = kind.split()
    if what == "item":
        for item in read_items(source, sa.select(ITEMS).where(ITEMS.c.item_id == content)):
            given = {name: getattr(item, name) for name in columns}
            write_items(target, [Item(item_id=item.item_id, first_seen=item.first_seen, **given)])
    elif what == "grasp":
        query_of_grasp = sa.select(GRASPS).where(GRASPS.c.grasp_id == content)
        for grasp in read_grasps(source, query_of_grasp).values():
            if grasp.calibration_id is not None:
                query = sa.select(CALIBRATIONS.c.content).where(
                    CALIBRATIONS.c.calibration_id == grasp.calibration_id
                )
                write_calibration(target, source.scalars(query).one())
            write_grasps(target, [grasp])
    else:
        query_of = sa.select(VERDICTS).where(VERDICTS.c.verdict_id == content)
        for verdict in read_verdicts(source, query_of):
            copy_record(source, target, "item", verdict.item_id)
            if verdict.grasp_id is not None:
                copy_record(source, target, "grasp", verdict.grasp_id)
            write_verdict(target, verdict)
