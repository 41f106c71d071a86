"""The store: every item, grasp, measurement, verdict and calibration that was used.

One SQLite file by default, PostgreSQL by URL; several processes may write at once. What was
acknowledged is on the disk.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, date, datetime, time, timedelta, tzinfo
from pathlib import Path
from types import TracebackType

import sqlalchemy as sa

from palpate.errors import InputError, StoreError
from palpate.produce.records import MEASURED, About, Grasp, Item, Reading, Source, Verdict
from palpate.produce.store_engine import faults_of, make_engine, shown, store_url
from palpate.produce.store_migrations import STEPS, found_version, migrate
from palpate.produce.store_reading import (
    narrowed,
    read_grasps,
    read_history,
    read_items,
    read_verdicts,
    verdict_query,
)
from palpate.produce.store_schema import CALIBRATIONS, GRASPS, ITEMS, VERDICTS
from palpate.produce.store_writing import (
    write_calibration,
    write_grasps,
    write_item,
    write_verdict,
)

#: Grasps fetched at a time where all are asked for.
_BATCH = 5000


class Store:
    """Memory of items and grasps; a context manager. Made by `Store.open`.

    Every method raises `StoreAwayError` where the database does not answer now (no server, locked,
    disk full) and `StoreError` where it can't be used as it is (read-only, damaged).

    Examples
    --------
    >>> with Store.open("sqlite://") as store:
    ...     store.add_item(Item(item_id="A17", kind="avocado", batch="Monday"))
    ...     [item.item_id for item in store.items(kind="avocado")]
    ['A17']
    """

    def __init__(self, engine: sa.Engine, *, name: str) -> None:
        self._reading = engine
        self._writing = engine.execution_options(writes=True)
        self.name = name

    @classmethod
    def open(cls, where: str | Path | None = None, *, create: bool = True) -> Store:
        """Open a store, make it where there is none, bring an older one to the present schema.

        Parameters
        ----------
        where : str or path, optional
            A file, or a URL: ``sqlite:///items.sqlite``, ``postgresql://user@host/database``. By
            default ``$PALPATE_STORE``, else ``palpate-items.sqlite`` in the current folder.
        create : bool
            False to refuse a file that is not there.

        Raises
        ------
        InputError
            If it is a URL of another kind of database.
        StoreError
            If it is no store, is read-only, damaged, or written by a newer palpate.
        StoreAwayError
            If it does not answer now.
        MissingExtraError
            If PostgreSQL is asked for without its driver.
        """
        url = store_url(where)
        name = shown(url)
        if url.get_backend_name() == "sqlite" and url.database and "uri" not in url.query:
            _check_file(Path(url.database), name=name, create=create)
        store = cls(make_engine(url), name=name)
        try:
            with faults_of(name):
                store._bring_up_to_date()
        except BaseException:
            store.close()
            raise
        return store

    def _bring_up_to_date(self) -> None:
        with self._reading.connect() as connection:
            before = found_version(connection, where=self.name)
        # One that needs nothing is not locked for it, and may be read-only.
        if before < len(STEPS):
            with self._writing.begin() as connection:
                migrate(connection, where=self.name)

    def add_item(self, item: Item) -> None:
        """Add an item, or fill in what is newly known of it: None leaves what is there."""
        with self._write() as connection:
            write_item(connection, item)

    def add_calibration(self, text: str) -> str:
        """Keep the text of a calibration file; return its id, the same for the same text."""
        with self._write() as connection:
            return write_calibration(connection, text)

    def add_grasp(self, grasp: Grasp) -> bool:
        """Add a grasp with its measurements in one transaction; False if it was there already.

        Raises
        ------
        InputError
            If its calibration is not in the store.
        """
        return self.add_grasps([grasp]) == 1

    def add_grasps(self, grasps: Iterable[Grasp]) -> int:
        """Add many grasps in one transaction; return how many were new.

        Raises
        ------
        InputError
            If one's calibration is not in the store.
        """
        with self._write() as connection:
            return write_grasps(connection, grasps)

    def add_verdict(self, verdict: Verdict) -> bool:
        """Add a verdict; False if it was there already.

        Raises
        ------
        InputError
            If its item or grasp is not in the store.
        """
        with self._write() as connection:
            return write_verdict(connection, verdict)

    def calibration(self, calibration_id: str) -> str:
        """Return the text of a calibration.

        Raises
        ------
        InputError
            If there is none with this id.
        """
        query = sa.select(CALIBRATIONS.c.content).where(
            CALIBRATIONS.c.calibration_id == calibration_id
        )
        with self._read() as connection:
            text: str | None = connection.scalar(query)
        if text is None:
            raise InputError(f"{self.name}: no calibration {calibration_id!r}")
        return text

    def item(self, item_id: str) -> Item:
        """Return one item.

        Raises
        ------
        InputError
            If there is none of that name.
        """
        with self._read() as connection:
            found = read_items(connection, sa.select(ITEMS).where(ITEMS.c.item_id == item_id))
        if not found:
            raise InputError(f"{self.name}: no item {item_id!r}; `palpate items` lists them")
        return found[0]

    def items(
        self,
        *,
        kind: str | None = None,
        batch: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
        limit: int | None = None,
    ) -> tuple[Item, ...]:
        """Return items, the last met first.

        Parameters
        ----------
        kind, batch : str, optional
            Only those.
        since, until : datetime, optional
            Only items first seen at or after `since`, and before `until`.
        limit : int, optional
            At most this many.
        """
        query = narrowed(sa.select(ITEMS), kind=kind, batch=batch)
        query = query.order_by(ITEMS.c.first_seen.desc(), ITEMS.c.item_id).limit(limit)
        with self._read() as connection:
            return read_items(connection, _within(query, ITEMS.c.first_seen, since, until))

    def grasps_of(self, item_id: str) -> tuple[Grasp, ...]:
        """Return the grasps of an item, oldest first; none for an item that is not known."""
        query = sa.select(GRASPS).where(GRASPS.c.item_id == item_id)
        with self._read() as connection:
            return read_grasps(connection, query.order_by(GRASPS.c.taken_at, GRASPS.c.number))

    def grasps(
        self,
        *,
        kind: str | None = None,
        batch: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
    ) -> Iterator[Grasp]:
        """Yield grasps in the order they were written, in bounded memory.

        Parameters
        ----------
        kind, batch : str, optional
            Only of such items.
        since, until : datetime, optional
            Only grasps taken at or after `since`, and before `until`.
        """
        query = _within(sa.select(GRASPS), GRASPS.c.taken_at, since, until)
        if kind is not None or batch is not None:
            query = narrowed(query.join(ITEMS), kind=kind, batch=batch)
        query = query.order_by(GRASPS.c.number).limit(_BATCH)
        last = -1
        while True:
            with self._read() as connection:
                numbers = query.with_only_columns(GRASPS.c.number).where(GRASPS.c.number > last)
                found = list(connection.scalars(numbers))
                if not found:
                    return
                batch_of = sa.select(GRASPS).where(GRASPS.c.number.in_(found))
                rows = read_grasps(connection, batch_of.order_by(GRASPS.c.number))
            yield from rows
            last = found[-1]

    def history(self, item_id: str, name: str) -> tuple[Reading, ...]:
        """Return one measurement of an item over its grasps, oldest first.

        Parameters
        ----------
        item_id : str
            Which item.
        name : str
            One of `MEASURED`: ``"stiffness_n_per_mm"``, ...

        Raises
        ------
        InputError
            If there is no such measurement.
        """
        if name not in MEASURED:
            raise InputError(f"measurement {name!r}: must be one of {', '.join(MEASURED)}")
        with self._read() as connection:
            return read_history(connection, item_id, name)

    def verdicts_of(
        self, item_id: str, *, about: About | None = None, source: Source | None = None
    ) -> tuple[Verdict, ...]:
        """Return what was said of an item, oldest first."""
        query = verdict_query().where(VERDICTS.c.item_id == item_id)
        if about is not None:
            query = query.where(VERDICTS.c.about == str(about))
        return self._verdicts(query, source)

    def verdicts(
        self, about: About, *, source: Source | None = None, kind: str | None = None
    ) -> tuple[Verdict, ...]:
        """Return what was said of all items, or of those of a kind: labels to learn from."""
        query = verdict_query().where(VERDICTS.c.about == str(about))
        if kind is not None:
            query = narrowed(query.join(ITEMS), kind=kind)
        return self._verdicts(query, source)

    def of_batch(self, batch: str) -> tuple[Item, ...]:
        """Return the items of a batch, the first met first."""
        return self.items(batch=batch)[::-1]

    def of_day(self, day: date, *, zone: tzinfo = UTC) -> tuple[Grasp, ...]:
        """Return the grasps of one day of a time zone, oldest first."""
        since, until = (
            datetime.combine(midnight, time.min, tzinfo=zone)
            for midnight in (day, day + timedelta(days=1))
        )
        query = _within(sa.select(GRASPS), GRASPS.c.taken_at, since, until)
        with self._read() as connection:
            return read_grasps(connection, query.order_by(GRASPS.c.taken_at, GRASPS.c.number))

    def close(self) -> None:
        """Let go of the database. May be called twice."""
        self._reading.dispose()

    def __enter__(self) -> Store:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _verdicts(
        self, query: sa.Select[tuple[object, ...]], source: Source | None
    ) -> tuple[Verdict, ...]:
        if source is not None:
            query = query.where(VERDICTS.c.source == str(source))
        with self._read() as connection:
            return read_verdicts(connection, query)

    @contextmanager
    def _read(self) -> Iterator[sa.Connection]:
        with faults_of(self.name), self._reading.connect() as connection:
            yield connection

    @contextmanager
    def _write(self) -> Iterator[sa.Connection]:
        with faults_of(self.name), self._writing.begin() as connection:
            yield connection


def _within(
    query: sa.Select[tuple[object, ...]],
    column: sa.Column[datetime],
    since: datetime | None,
    until: datetime | None,
) -> sa.Select[tuple[object, ...]]:
    for moment in (since, until):
        if moment is not None and moment.tzinfo is None:
            raise InputError(f"{moment.isoformat()}: has no time zone; give one, as in 08:00Z")
    if since is not None:
        query = query.where(column >= since)
    return query if until is None else query.where(column < until)


def _check_file(path: Path, *, name: str, create: bool) -> None:
    if path.is_dir():
        raise StoreError(f"{name}: a folder; name a file in it")
    if not path.parent.is_dir():
        raise StoreError(f"{name}: there is no folder {path.parent}; make it first")
    if not create and not path.exists():
        raise StoreError(
            f"{name}: no such file; `palpate grasp --item NAME --store FILE` makes one, or name "
            "another with --store or $PALPATE_STORE"
        )
