"""The store of items, grasps, measurements, verdicts and calibrations.

Each record is written to a local SQLite file in one transaction. Several processes can write at the
same time. With a PostgreSQL server as shared store, an outbox in the local file holds the records
for the server. The history is then read from the server, because it also contains the grasps of
other stations.
"""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

import sqlalchemy as sa

from palpate.errors import StoreAwayError, StoreError, StoreMissingError
from palpate_station.records import Grasp, Item, Verdict
from palpate_station.store.engine import (
    make_engine,
    read_only_url,
    show_url,
    store_url,
    translate_errors,
)
from palpate_station.store.outbox import (
    SHARED,
    copy_record,
    count_waiting,
    enqueue,
    item_kind,
    read_waiting,
    remove,
    remove_oldest,
)
from palpate_station.store.reading import StoreReader
from palpate_station.store.schema import GRASPS, ITEMS, NEWEST, migrate, read_version
from palpate_station.store.writing import (
    write_calibration,
    write_grasps,
    write_items,
    write_verdict,
)

_Read = TypeVar("_Read")
#: Maximum number of records per transaction to the shared store.
_SEND_BATCH = 200


class Store(StoreReader):
    """Store of items and grasps; a context manager. Create it with `Store.open`.

    Every method raises `StoreAwayError` if the local file is temporarily not available (locked,
    disk full), and `StoreError` if it is unusable (read-only, damaged).

    `shared`: URL of the PostgreSQL server; the connection opens on first use.

    >>> with Store.open("sqlite://") as store:
    ...     store.add_item(Item(item_id="A17", kind="avocado", batch="Monday"))
    ...     [item.item_id for item in store.items(kind="avocado")]
    ['A17']
    """

    def __init__(self, engine: sa.Engine, *, name: str, shared: sa.URL | None = None) -> None:
        super().__init__(engine, name=name)
        self._writing = engine.execution_options(writes=True)
        self._shared_url = shared
        self._server: Store | None = None
        if shared is not None:
            self.name = show_url(shared)

    @classmethod
    def open(cls, where: str | Path | None = None, *, create: bool = True) -> Store:
        """Open a store; create a missing store and migrate an old schema.

        `where`: a file, or a URL: ``sqlite:///items.sqlite``, ``postgresql://user@host/database``.
            By default ``$PALPATE_STORE``, else ``palpate-items.sqlite`` in the current folder.
            The local file of a server is in ``$XDG_STATE_HOME/palpate``.
        `create`: False to refuse a missing file and to accept a read-only file.
        Raises `InputError` for a URL of another kind of database; `StoreError` if the file is not a
        store, is read-only, is damaged, or was written by a newer palpate; `StoreAwayError` if the
        database is temporarily not available; `MissingExtraError` for PostgreSQL without its
        driver.
        """
        url, shared = store_url(where), None
        if url.get_backend_name() != "sqlite":
            make_engine(url).dispose()  # raises if the driver is missing
            url, shared, create = store_url(_local_file(url)), url, True
        name = show_url(url)
        if url.database and "uri" not in url.query:
            _check_file(Path(url.database), name=name, create=create)
            if not create:
                url = read_only_url(url)
        return cls._open_url(url, name=name, shared=shared, create=create)

    @classmethod
    def _open_url(cls, url: sa.URL, *, name: str, shared: sa.URL | None, create: bool) -> Store:
        store = cls(make_engine(url), name=name, shared=shared)
        try:
            store._migrate_if_old(create=create)
        except BaseException:
            store.close()
            raise
        return store

    def add_item(self, item: Item) -> None:
        """Add an item, or update its fields; None leaves a field unchanged."""
        with self._write() as connection:
            write_items(connection, [item])
            self._enqueue(connection, [(item_kind(item), item.item_id)])

    def add_calibration(self, text: str) -> str:
        """Add the text of a calibration file; return its ID, equal for equal text."""
        with self._write() as connection:
            return write_calibration(connection, text)

    def add_grasp(self, grasp: Grasp, *, calibration: str | None = None) -> bool:
        """Add a grasp with its measurements in one transaction; False if already stored.

        `calibration`: text of the grasp's calibration, added if missing.
        Raises `InputError` if the calibration is neither given nor in the store.
        """
        return self.add_grasps([grasp], calibration=calibration) == 1

    def add_grasps(self, grasps: Iterable[Grasp], *, calibration: str | None = None) -> int:
        """Add grasps in one transaction; return the number of new grasps.

        `calibration`: text of a calibration, added if missing.
        Raises `InputError` if the calibration of a grasp is not in the store.
        """
        with self._write() as connection:
            if calibration is not None:
                write_calibration(connection, calibration)
            added = write_grasps(connection, grasps)
            self._enqueue(connection, [("grasp", grasp_id) for grasp_id in added])
        return len(added)

    def add_verdict(self, verdict: Verdict) -> bool:
        """Add a verdict; False if already stored.

        Raises `InputError` if the item or grasp is not in the store.
        """
        if self._shared_url is not None:
            self._copy_subject(verdict)
        with self._write() as connection:
            is_new = write_verdict(connection, verdict)
            if is_new:
                self._enqueue(connection, [("verdict", verdict.verdict_id)])
        return is_new

    def send(self) -> int:
        """Send the queued records to the shared store, in order; return their number.

        Raises `StoreAwayError` if the shared store does not answer, and `StoreError` if it is
        unusable; unacknowledged records remain in the outbox.
        """
        sent = 0
        while rows := self._read_waiting():
            with (
                translate_errors(self.local_name),
                self._reading.connect() as local,
                self._open_server()._write() as remote,
            ):
                for row in rows:
                    copy_record(local, remote, row.kind, row.content)
            with self._write() as connection:
                remove(connection, [row.number for row in rows])
            sent += len(rows)
        return sent

    def check_shared(self) -> None:
        """Do nothing if the shared store answers, or if there is none.

        Raises `StoreAwayError` if it does not answer, and `StoreError` if it is unusable.
        """
        if self._shared_url is not None:
            self._open_server()._fetch(lambda connection: connection.scalar(sa.select(1)))

    def waiting(self, receiver: str = SHARED) -> int:
        """Return the number of records or messages that wait for a receiver."""
        return super()._fetch(lambda connection: count_waiting(connection, receiver))

    def try_send(self) -> str:
        """Send the queued records; return a warning on failure, otherwise an empty string."""
        try:
            self.send()
        except StoreError as error:
            return f"{error}; {self.local_name} has the records, and the next command sends them"
        return ""

    def add_message(self, text: str, *, receiver: str, most: int) -> int:
        """Queue a message; keep the newest `most` and return the number removed."""
        with self._write() as connection:
            enqueue(connection, receiver, [("message", text)])
            return remove_oldest(connection, receiver, most=most)

    def oldest_message(self, receiver: str) -> tuple[int, str] | None:
        """Return number and text of a receiver's oldest message; None without one."""
        rows = super()._fetch(lambda connection: read_waiting(connection, receiver, limit=1))
        return (rows[0].number, rows[0].content) if rows else None

    def remove_message(self, number: int) -> None:
        """Remove an acknowledged message."""
        with self._write() as connection:
            remove(connection, [number])

    def close(self) -> None:
        """Close the database; closing again has no effect."""
        self._reading.dispose()
        if self._server is not None:
            self._server.close()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    # -- the shared store -------------------------------------------------------------------------

    def _fetch(self, read: Callable[[sa.Connection], _Read]) -> _Read:
        if self._shared_url is not None and self.away is None:
            try:
                self.send()
                return self._open_server()._fetch(read)
            except StoreAwayError as error:
                self.away = error
        return super()._fetch(read)

    def _open_server(self) -> Store:
        if self._server is None:
            url = self._shared_url
            assert url is not None
            self._server = Store._open_url(url, name=show_url(url), shared=None, create=True)
        return self._server

    def _read_waiting(self) -> list[sa.Row[tuple[int, str, str, str]]]:
        if self._shared_url is None:
            return []
        return super()._fetch(lambda c: list(read_waiting(c, SHARED, limit=_SEND_BATCH)))

    def _copy_subject(self, verdict: Verdict) -> None:
        """Copy a verdict's item and grasp to the local store, if missing."""
        item = sa.select(ITEMS.c.item_id).where(ITEMS.c.item_id == verdict.item_id)
        grasp = sa.select(GRASPS.c.grasp_id).where(GRASPS.c.grasp_id == verdict.grasp_id)
        missing = super()._fetch(lambda c: (c.scalar(item) is None, c.scalar(grasp) is None))
        if not (missing[0] or (missing[1] and verdict.grasp_id is not None)):
            return

        def copy(remote: sa.Connection) -> None:
            with self._write() as local:
                copy_record(remote, local, "item kind batch label", verdict.item_id)
                if verdict.grasp_id is not None:
                    copy_record(remote, local, "grasp", verdict.grasp_id)

        try:
            self._open_server()._fetch(copy)
        except StoreAwayError as error:
            self.away = error

    # -- writing ------------------------------------------------------------------------------

    def _enqueue(self, connection: sa.Connection, rows: list[tuple[str, str]]) -> None:
        """Queue records for the shared store, in the transaction that writes them."""
        if self._shared_url is not None:
            enqueue(connection, SHARED, rows)

    @contextmanager
    def _write(self) -> Iterator[sa.Connection]:
        with translate_errors(self.local_name), self._writing.begin() as connection:
            yield connection

    def _migrate_if_old(self, *, create: bool) -> None:
        with translate_errors(self.local_name):
            with self._reading.connect() as connection:
                before = read_version(connection, where=self.local_name)
            # A store with the current schema needs no lock and may be read-only.
            if before == NEWEST[connection.dialect.name]:
                return
            try:
                with self._write() as connection:
                    migrate(connection, where=self.local_name)
            except StoreError:
                # An older store on a read-only medium remains readable without migration.
                if create or before == 0:
                    raise
                with self._reading.connect() as connection:
                    found = sa.inspect(connection).get_columns(GRASPS.name)
                self._missing = frozenset(GRASPS.c.keys()) - {one["name"] for one in found}


def _local_file(server: sa.URL) -> Path:
    """Return the local file for a server's records; create its folder if missing."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    folder, number = state / "palpate", hashlib.sha256(show_url(server).encode()).hexdigest()[:12]
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(
            f"{folder}: can't be created ({error.strerror}); set $XDG_STATE_HOME to another folder"
        ) from error
    return folder / f"items-{number}.sqlite"


def _check_file(path: Path, *, name: str, create: bool) -> None:
    if path.is_dir():
        raise StoreError(f"{name}: is a folder; name a file in it")
    if not path.parent.is_dir():
        raise StoreError(f"{name}: the folder {path.parent} does not exist; create it first")
    if not create and not path.exists():
        raise StoreMissingError(
            f"{name}: no such file; `palpate grasp --item NAME --store FILE` creates it, or name "
            "another file with --store or $PALPATE_STORE"
        )
