"""The store: every item, grasp, measurement, verdict and calibration that was used.

One SQLite file by default, PostgreSQL by URL; several processes may write at once. What was
acknowledged is on the disk.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from palpate.errors import StoreError
from palpate.produce.records import Grasp, Item, Verdict
from palpate.produce.store.engine import faults_of, make_engine, sa, shown, store_url, url_to_read
from palpate.produce.store.reading import StoreReader
from palpate.produce.store.schema import MIGRATIONS, found_version, migrate
from palpate.produce.store.writing import (
    write_calibration,
    write_grasps,
    write_item,
    write_verdict,
)


class Store(StoreReader):
    """Memory of items and grasps; a context manager. Made by `Store.open`.

    Every method raises `StoreAwayError` where the database does not answer now (no server, locked,
    disk full) and `StoreError` where it can't be used as it is (read-only, damaged).

    >>> with Store.open("sqlite://") as store:
    ...     store.add_item(Item(item_id="A17", kind="avocado", batch="Monday"))
    ...     [item.item_id for item in store.items(kind="avocado")]
    ['A17']
    """

    def __init__(self, engine: sa.Engine, *, name: str) -> None:
        super().__init__(engine, name=name)
        self._writing = engine.execution_options(writes=True)

    @classmethod
    def open(cls, where: str | Path | None = None, *, create: bool = True) -> Store:
        """Open a store, create it if missing, bring an older one to the present schema.

        `where`: a file, or a URL: ``sqlite:///items.sqlite``, ``postgresql://user@host/database``.
            By default ``$PALPATE_STORE``, else ``palpate-items.sqlite`` in the current folder.
        `create`: False to refuse a file that is not there, and to take one that can only be read.
        Raises `InputError` if it is a URL of another kind of database; `StoreError` if it is no
        store, is read-only, damaged, or written by a newer palpate; `StoreAwayError` if it does not
        answer now; `MissingExtraError` if PostgreSQL is asked for without its driver.
        """
        url = store_url(where)
        name = shown(url)
        if url.get_backend_name() == "sqlite" and url.database and "uri" not in url.query:
            _check_file(Path(url.database), name=name, create=create)
            if not create:
                url = url_to_read(url)
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
        if before < 1 + len(MIGRATIONS):
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

        Raises `InputError` if its calibration is not in the store.
        """
        return self.add_grasps([grasp]) == 1

    def add_grasps(self, grasps: Iterable[Grasp]) -> int:
        """Add many grasps in one transaction; return how many were new.

        Raises `InputError` if one's calibration is not in the store.
        """
        with self._write() as connection:
            return write_grasps(connection, grasps)

    def add_verdict(self, verdict: Verdict) -> bool:
        """Add a verdict; False if it was there already.

        Raises `InputError` if its item or grasp is not in the store.
        """
        with self._write() as connection:
            return write_verdict(connection, verdict)

    def close(self) -> None:
        """Let go of the database. May be called twice."""
        self._reading.dispose()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    @contextmanager
    def _write(self) -> Iterator[sa.Connection]:
        with faults_of(self.name), self._writing.begin() as connection:
            yield connection


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
