"""Durability of acknowledged records: power failure, second writer, frozen server."""

from __future__ import annotations

import os
import signal
import sqlite3
import stat
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from palpate.errors import StoreAwayError
from palpate.files import atomic_path
from palpate_station.records import Item
from palpate_station.store import Store
from palpate_station.store.engine import make_engine, store_url


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Return a list of all file syncs: inode and size at the sync."""
    calls: list[tuple[int, int]] = []
    original_fsync = os.fsync

    def fsync(descriptor: int) -> None:
        found = os.fstat(descriptor)
        calls.append((found.st_ino, found.st_size))
        original_fsync(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    return calls


def test_atomic_path_syncs_file_and_folder(tmp_path: Path, synced: list[tuple[int, int]]) -> None:
    final = tmp_path / "pad.json"
    with atomic_path(final) as partial:
        partial.write_text("12345")
        inode = partial.stat().st_ino
    assert synced == [(inode, 5), (tmp_path.stat().st_ino, tmp_path.stat().st_size)]


def test_atomic_path_preserves_mode_and_symlink(tmp_path: Path) -> None:
    real, link = tmp_path / "real.json", tmp_path / "link.json"
    real.write_text("old")
    real.chmod(0o640)
    link.symlink_to(real)
    with atomic_path(link) as partial:
        partial.write_text("new")
    assert link.is_symlink()
    assert (real.read_text(), stat.S_IMODE(real.stat().st_mode)) == ("new", 0o640)


@contextmanager
def transaction(path: Path, *, writes: bool) -> Iterator[Any]:
    engine = make_engine(store_url(path))
    with engine.connect().execution_options(writes=writes) as connection, connection.begin():
        yield connection
    engine.dispose()


def test_sqlite_writer_locks_at_begin_and_reader_does_not_lock(tmp_path: Path) -> None:
    path = tmp_path / "items.sqlite"
    Store.open(path).close()
    with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as other:
        locked = pytest.raises(sqlite3.OperationalError, match="locked")
        with transaction(path, writes=True), locked:
            other.execute("BEGIN IMMEDIATE")
        with transaction(path, writes=False):
            other.execute("BEGIN IMMEDIATE")
            other.execute("ROLLBACK")


def test_sqlite_commit_uses_full_synchronisation(tmp_path: Path) -> None:
    with transaction(tmp_path / "items.sqlite", writes=False) as connection:
        pragmas = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("synchronous", "journal_mode", "foreign_keys")
        }
    assert pragmas == {"synchronous": 2, "journal_mode": "wal", "foreign_keys": 1}


@pytest.mark.slow
def test_frozen_server_neither_loses_records_nor_blocks_writers(
    postgresql_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import psycopg

    from palpate_station.store import postgresql as store_postgresql

    monkeypatch.setattr(store_postgresql, "ANSWER_S", 0.3)
    url = f"{postgresql_url}&connect_timeout=2"
    with psycopg.connect(postgresql_url) as admin, Store.open(url) as store:
        store.add_item(Item(item_id="before"))
        store.send()
        others = "WHERE client_port = -1 AND pid <> pg_backend_pid()"
        backends = [pid for (pid,) in admin.execute(f"SELECT pid FROM pg_stat_activity {others}")]
        parent = int(Path(f"/proc/{backends[0]}/stat").read_text().rsplit(")", 1)[1].split()[1])
        frozen = [parent, *backends]
        for pid in frozen:
            os.kill(pid, signal.SIGSTOP)
        try:
            store.add_item(Item(item_id="frozen"))
            with pytest.raises(StoreAwayError, match="no answer"):
                store.send()
            assert {item.item_id for item in store.items()} == {"before", "frozen"}
            assert "no answer" in str(store.away)
        finally:
            for pid in frozen:
                os.kill(pid, signal.SIGCONT)
        store.add_item(Item(item_id="after"))
        assert store.send() == 2
    with Store.open(postgresql_url) as store:
        assert {item.item_id for item in store.items()} == {"before", "frozen", "after"}
