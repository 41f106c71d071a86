"""Back up and restore the SQLite file of a store while other processes use it."""

from __future__ import annotations

import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

from palpate.errors import InputError, StoreError
from palpate.files import atomic_path
from palpate_station.store.database import Store
from palpate_station.store.engine import LOCK_TIMEOUT_S, show_url, store_url


def back_up(where: str | None, path: Path) -> int:
    """Copy a store to a file, consistent as of one moment; return its number of items.

    Writers are not blocked. The copy is one file, without the helper files of SQLite.
    Raises `StoreError` if the store is missing, unusable or damaged, and `InputError` for a store
    on a server.
    """
    source = _local_file(where)
    # Refuses a missing file and another program's database.
    Store.open(where, create=False).close()
    with atomic_path(path) as partial:
        try:
            with (
                closing(sqlite3.connect(source, timeout=LOCK_TIMEOUT_S)) as original,
                closing(sqlite3.connect(partial)) as copy,
            ):
                original.backup(copy)
                copy.execute("PRAGMA journal_mode = DELETE")
        except sqlite3.Error as error:
            raise StoreError(f"{source}: the backup failed ({error})") from error
        return _count_items(partial, name=str(path))


def restore_backup(where: str | None, path: Path) -> tuple[int, str]:
    """Create a store from a backup; return its number of items and its name.

    Raises `InputError` if the store exists already, because its records would be lost, and
    `StoreError` if the backup is not a store or is damaged.
    """
    target = _local_file(where)
    if not path.is_file():
        raise InputError(f"--restore {path}: no such file")
    helpers = [Path(f"{target}{end}") for end in ("", "-wal", "-shm")]
    if existing := [str(one) for one in helpers if one.exists()]:
        raise InputError(
            f"--restore: {', '.join(existing)} exists; end the programs that use the store, move "
            "the file to another folder, and try again"
        )
    with atomic_path(target) as partial:
        shutil.copyfile(path, partial)
        found = _count_items(partial, name=str(path))
    return found, show_url(store_url(where))


def _local_file(where: str | None) -> Path:
    url = store_url(where)
    if url.get_backend_name() != "sqlite" or not url.database:
        raise InputError(
            f"{show_url(url)}: not a file; back up a PostgreSQL server with pg_dump and pg_restore"
        )
    return Path(url.database)


def _count_items(path: Path, *, name: str) -> int:
    """Return the number of items of a store that no other process uses, and check every page."""
    try:
        with closing(sqlite3.connect(path)) as connection:
            (state,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
            if state != "ok":
                raise StoreError(f"{name}: is damaged ({' '.join(state.split())})")
            found: int = connection.execute("SELECT count(*) FROM items").fetchone()[0]
            connection.execute("SELECT version FROM palpate_schema").fetchone()
    except sqlite3.Error as error:
        raise StoreError(f"{name}: not a store ({error})") from error
    return found
