"""Reading of items, grasps and verdicts from a store."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from datetime import datetime
from functools import partial
from typing import Any, TypeVar

import sqlalchemy as sa

from palpate.errors import InputError, PalpateError, StoreAwayError
from palpate.measurement import Measurement, Status
from palpate_station.records import MEASURED, About, Grasp, Item, Source, Verdict
from palpate_station.store.engine import damage_error, translate_errors
from palpate_station.store.schema import (
    CALIBRATIONS,
    GRASPS,
    ITEMS,
    MEASUREMENTS,
    OLD_FIRMNESS_FORCE_N,
    VERDICTS,
)

_Read = TypeVar("_Read")
_Value = TypeVar("_Value")

#: Maximum length of an IN list, below SQLite's parameter limit in every build.
_MOST_VALUES = 500
#: Number of grasps per query when reading all grasps.
_BATCH = 5000
#: Measurements in stores of older versions, ignored here.
_RETIRED = ("firmness_n_per_mm", "sheet_gain", "firmness_force_n")
_IN_TIME = (GRASPS.c.taken_at, GRASPS.c.number)


def read_items(connection: sa.Connection, query: sa.Select[Any]) -> tuple[Item, ...]:
    """Return the items found by a query over `ITEMS`."""
    return tuple(Item(**row) for row in connection.execute(query).mappings())


def read_grasps(connection: sa.Connection, query: sa.Select[Any]) -> dict[int, Grasp]:
    """Return the grasps found by a query over `GRASPS`, by number, in query order."""
    rows = [dict(row) for row in connection.execute(query).mappings()]
    numbers = [row.pop("number") for row in rows]
    measured = _measurements(connection, numbers)
    return {
        number: Grasp(**row, measurements=measured.get(number, {}))
        for number, row in zip(numbers, rows, strict=True)
    }


def read_verdicts(connection: sa.Connection, query: sa.Select[Any]) -> tuple[Verdict, ...]:
    """Return the verdicts found by a query over `VERDICTS`."""
    return tuple(Verdict(**row) for row in connection.execute(query).mappings())


def filter_items(
    query: sa.Select[Any], *, kind: str | None = None, batch: str | None = None
) -> sa.Select[Any]:
    """Restrict a query to items of one kind and batch."""
    if kind is not None:
        query = query.where(ITEMS.c.kind == kind)
    if batch is not None:
        query = query.where(ITEMS.c.batch == batch)
    return query


def verdict_query() -> sa.Select[Any]:
    """Return a query over all verdicts, oldest first."""
    return sa.select(VERDICTS).order_by(VERDICTS.c.given_at, VERDICTS.c.verdict_id)


def _split(values: Sequence[_Value]) -> Iterator[Sequence[_Value]]:
    """Split values into parts for one IN list each."""
    for start in range(0, len(values), _MOST_VALUES):
        yield values[start : start + _MOST_VALUES]


def _measurements(
    connection: sa.Connection, numbers: Sequence[int]
) -> dict[int, dict[str, Measurement]]:
    found: dict[int, dict[str, Measurement]] = {}
    for part in _split(numbers):
        query = sa.select(MEASUREMENTS).where(
            MEASUREMENTS.c.grasp_number.in_(part), MEASUREMENTS.c.name.not_in(_RETIRED)
        )
        for row in connection.execute(query).mappings():
            found.setdefault(row["grasp_number"], {})[row["name"]] = Measurement(
                value=row["value"],
                low=-math.inf if row["low"] is None else row["low"],
                high=math.inf if row["high"] is None else row["high"],
                unit=MEASURED[row["name"]],
                level=row["level"],
                status=Status(row["status"]),
            )
    return found


class StoreReader:
    """Base class of `Store` with the reading methods.

    Every method raises `StoreAwayError` if the database is temporarily not available, and
    `StoreError` if it is unusable.

    `name`: name of the store in messages; `local_name` is the name of the local file.
    """

    def __init__(self, engine: sa.Engine, *, name: str) -> None:
        self._reading = engine
        #: Columns of grasps that an older store on a read-only medium lacks.
        self._missing: frozenset[str] = frozenset()
        self.name = self.local_name = name
        #: Error of the shared store, after which only local records are read; None without error.
        self.away: StoreAwayError | None = None

    def calibration(self, calibration_id: str) -> str:
        """Return the text of a calibration.

        Raises `InputError` if there is no calibration with this ID.
        """
        query = sa.select(CALIBRATIONS.c.content).where(
            CALIBRATIONS.c.calibration_id == calibration_id
        )
        text: str | None = self._fetch(lambda connection: connection.scalar(query))
        if text is None:
            raise InputError(f"{self.name}: no calibration {calibration_id!r}")
        return text

    def item(self, item_id: str) -> Item:
        """Return one item.

        Raises `InputError` if there is no item with this name.
        """
        found = self.find_items([item_id])
        if not found:
            raise InputError(f"{self.name}: no item {item_id!r}; `palpate items` lists them")
        return found[0]

    def items(
        self,
        *,
        kind: str | None = None,
        batch: str | None = None,
        limit: int | None = None,
    ) -> tuple[Item, ...]:
        """Return at most `limit` items of this kind and batch, newest first."""
        query = filter_items(sa.select(ITEMS), kind=kind, batch=batch)
        query = query.order_by(ITEMS.c.first_seen.desc(), ITEMS.c.item_id).limit(limit)
        return self._fetch(lambda connection: read_items(connection, query))

    def find_items(self, item_ids: Sequence[str]) -> tuple[Item, ...]:
        """Return the known items in the order of the names."""

        def read(connection: sa.Connection) -> dict[str, Item]:
            conditions = map(ITEMS.c.item_id.in_, _split(item_ids))
            queries = (sa.select(ITEMS).where(condition) for condition in conditions)
            return {item.item_id: item for q in queries for item in read_items(connection, q)}

        found = self._fetch(read)
        return tuple(found[name] for name in item_ids if name in found)

    def grasps_of(self, item_id: str) -> tuple[Grasp, ...]:
        """Return the grasps of an item, oldest first; empty for an unknown item."""
        query = self._grasp_query().where(GRASPS.c.item_id == item_id).order_by(*_IN_TIME)
        return tuple(self._fetch(lambda connection: read_grasps(connection, query)).values())

    def histories(
        self, item_ids: Sequence[str]
    ) -> Iterator[tuple[tuple[Grasp, ...], tuple[Verdict, ...]]]:
        """Yield the grasps and the verdicts of each item, in the order of the names."""
        for names in _split(item_ids):
            grasps: dict[str, list[Grasp]] = {name: [] for name in names}
            verdicts: dict[str, list[Verdict]] = {name: [] for name in names}
            of_grasps = self._grasp_query().where(GRASPS.c.item_id.in_(names)).order_by(*_IN_TIME)
            of_verdicts = verdict_query().where(VERDICTS.c.item_id.in_(names))
            found = self._fetch(partial(_read_both, grasps=of_grasps, verdicts=of_verdicts))
            for grasp in found[0].values():
                grasps[grasp.item_id].append(grasp)
            for verdict in found[1]:
                verdicts[verdict.item_id].append(verdict)
            for name in names:
                yield tuple(grasps[name]), tuple(verdicts[name])

    def grasps(
        self,
        *,
        kind: str | None = None,
        batch: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
    ) -> Iterator[Grasp]:
        """Yield grasps in the order of writing, with bounded memory.

        `kind`, `batch`: only grasps of items of this kind and batch.
        `since`, `until`: only grasps taken at or after `since`, and before `until`.
        """
        query = self._grasp_query()
        if since is not None:
            query = query.where(GRASPS.c.taken_at >= since)
        if until is not None:
            query = query.where(GRASPS.c.taken_at < until)
        if kind is not None or batch is not None:
            query = filter_items(query.join(ITEMS), kind=kind, batch=batch)
        query = query.order_by(GRASPS.c.number).limit(_BATCH)

        def read(connection: sa.Connection, after: int) -> dict[int, Grasp]:
            return read_grasps(connection, query.where(GRASPS.c.number > after))

        found = self._fetch(partial(read, after=-1))
        error_before = self.away
        while found:
            yield from found.values()
            found = self._fetch(partial(read, after=max(found)))
            # The local database numbers grasps differently, so the iteration can't continue there.
            if self.away is not error_before and self.away is not None:
                raise self.away

    def verdicts_of(
        self, item_id: str, *, about: About | None = None, source: Source | None = None
    ) -> tuple[Verdict, ...]:
        """Return the verdicts on an item, oldest first."""
        query = verdict_query().where(VERDICTS.c.item_id == item_id)
        return self._verdicts(query, about=about, source=source)

    def verdicts(
        self, about: About, *, source: Source | None = None, kind: str | None = None
    ) -> tuple[Verdict, ...]:
        """Return the verdicts about a subject on all items, or on items of one kind."""
        query = filter_items(verdict_query().join(ITEMS), kind=kind)
        return self._verdicts(query, about=about, source=source)

    def items_of_batch(self, batch: str) -> tuple[Item, ...]:
        """Return the items of a batch, oldest first."""
        return self.items(batch=batch)[::-1]

    def _grasp_query(self) -> sa.Select[Any]:
        """Return a query over all grasps."""
        # A shared store is migrated when it is opened.
        columns: list[sa.ColumnElement[Any]] = [c for c in GRASPS.c if c.name not in self._missing]
        if (name := GRASPS.c.firmness_force_n.name) in self._missing:
            columns.append(OLD_FIRMNESS_FORCE_N.label(name))
        return sa.select(*columns)

    def _verdicts(
        self, query: sa.Select[Any], *, about: About | None, source: Source | None
    ) -> tuple[Verdict, ...]:
        if about is not None:
            query = query.where(VERDICTS.c.about == str(about))
        if source is not None:
            query = query.where(VERDICTS.c.source == str(source))
        return self._fetch(lambda connection: read_verdicts(connection, query))

    def _fetch(self, read: Callable[[sa.Connection], _Read]) -> _Read:
        with translate_errors(self.local_name), self._reading.connect() as connection:
            try:
                return read(connection)
            except PalpateError:
                raise
            # Invalid content of a row fails when the record is created.
            except (ValueError, TypeError, KeyError, AttributeError) as error:
                raise damage_error(self.local_name) from error


def _read_both(
    connection: sa.Connection, *, grasps: sa.Select[Any], verdicts: sa.Select[Any]
) -> tuple[dict[int, Grasp], tuple[Verdict, ...]]:
    return read_grasps(connection, grasps), read_verdicts(connection, verdicts)
