"""Nothing is lost while the store is away: records go to the spool, and to the store later."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

from palpate.errors import InputError, StoreAwayError, StoreError
from palpate.produce.records import Grasp, Item, Verdict
from palpate.produce.records_json import CalibrationText, Record
from palpate.produce.spool import Spool, spool_path
from palpate.produce.store import Store
from palpate.produce.store_engine import lasting_name, store_url


class Keeper:
    """Writes to a store, or to its spool for as long as the store does not answer.

    Opening it refuses what no waiting would mend: a file that is no store, a newer schema. What
    waits from earlier is written as soon as the store answers, before what is new.

    Parameters
    ----------
    where : str or path, optional
        The store, as `Store.open` takes it.
    spool : Spool, optional
        Where records wait; by default a file of this store's own, see `spool_path`.

    Attributes
    ----------
    away : StoreError or None
        Why records go to the spool; None while the store takes them.

    Raises
    ------
    InputError, StoreError
        If the store can't be used as it is.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with Keeper(folder / "items.sqlite", spool=Spool(folder / "waiting.jsonl")) as keeper:
    ...     keeper.keep(Item(item_id="A17"))
    True
    """

    def __init__(self, where: str | Path | None = None, *, spool: Spool | None = None) -> None:
        self._where = where
        self.spool = spool or spool_of(where)
        self._store: Store | None = None
        self.away: StoreError | None = None
        try:
            self._arrived()
        except StoreAwayError as error:
            self.away = error

    def keep(self, *records: Record) -> bool:
        """Write records in order; True where the store has them, False where they wait.

        They go to the spool first: a store that never answers, or a program that is ended while
        it waits for one, loses nothing.

        Raises
        ------
        InputError
            If the store refuses one of them for what it says.
        OSError
            If the spool can't be written, and the store did not take them either.
        """
        try:
            self.spool.add(*records)
        except OSError as full:
            # The store alone may still take them.
            if self._straight(records):
                return True
            raise full
        refused: list[InputError] = []

        def write(record: Record) -> None:
            try:
                _write(self._opened(), record)
            except InputError as error:
                if record in records:
                    refused.append(error)
                raise

        try:
            self.spool.drain(write)
        except StoreError as error:
            self.away = error
            return False
        self.away = None
        if refused:
            raise refused[0]
        return True

    def _straight(self, records: tuple[Record, ...]) -> bool:
        try:
            store = self._arrived()
            for record in records:
                _write(store, record)
        except StoreError as error:
            self.away = error
            return False
        self.away = None
        return True

    def drain(self) -> int:
        """Write what waits to the store; return how many records were taken.

        Raises
        ------
        StoreError
            If the store still does not take them; they go on waiting.
        """
        return drain(self.spool, into=self._opened())

    def close(self) -> None:
        """Let go of the store. May be called twice."""
        if self._store is not None:
            self._store.close()
            self._store = None

    def __enter__(self) -> Keeper:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _opened(self) -> Store:
        if self._store is None:
            self._store = Store.open(self._where)
        return self._store

    def _arrived(self) -> Store:
        self.drain()
        return self._opened()


def drain(spool: Spool, *, into: Store) -> int:
    """Write what waits to a store that is open; return how many records were taken.

    Raises
    ------
    StoreError
        If the store does not take them; they go on waiting.
    """
    return spool.drain(lambda record: _write(into, record))


def spool_of(where: str | Path | None) -> Spool:
    """Return where records wait for a store that the user names so."""
    return Spool(spool_path(lasting_name(store_url(where))))


def _write(store: Store, record: Record) -> None:
    match record:
        case Item():
            store.add_item(record)
        case CalibrationText():
            store.add_calibration(record.content)
        case Grasp():
            store.add_grasp(record)
        case Verdict():
            store.add_verdict(record)
