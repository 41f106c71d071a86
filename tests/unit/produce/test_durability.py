"""What is acknowledged survives a power cut, a second writer and a server that never answers."""

from __future__ import annotations

import fcntl
import os
import signal
import sqlite3
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from palpate.errors import InputError
from palpate.files import atomic_path
from palpate.produce.records import About, Item, Verdict
from palpate.produce.store import Store
from palpate.produce.store.engine import make_engine, store_url
from palpate.produce.store.outbox import Keeper, Spool

TIME = datetime(2026, 5, 1, 8, tzinfo=UTC)


@pytest.fixture
def synced(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """Return a list that fills with what reached the disk: inode, and its size at that moment."""
    calls: list[tuple[int, int]] = []
    really = os.fsync

    def fsync(descriptor: int) -> None:
        found = os.fstat(descriptor)
        calls.append((found.st_ino, found.st_size))
        really(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    return calls


def test_a_spooled_record_and_its_file_are_on_the_disk_before_it_is_acknowledged(
    tmp_path: Path, synced: list[tuple[int, int]]
) -> None:
    spool = Spool(tmp_path / "waiting.jsonl")
    for name in ("A", "B"):
        spool.add(Item(item_id=name))
        found = spool.path.stat()
        assert (found.st_ino, found.st_size) in synced
    assert tmp_path.stat().st_ino in [inode for inode, _ in synced]
    synced.clear()

    def refuse(record: object) -> None:
        raise InputError("no")

    spool.drain(refuse)
    refused = spool.path.with_suffix(".refused").stat()
    assert synced[0] == (refused.st_ino, refused.st_size)
    assert (spool.path.stat().st_ino, 0) in synced


def test_a_changed_line_of_the_spool_is_not_taken_for_a_record(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "waiting.jsonl")
    spool.add(Item(item_id="A17"), Item(item_id="B2"))
    spool.path.write_bytes(spool.path.read_bytes().replace(b"A17", b"A71"))
    assert [record.item_id for record in spool.waiting()] == ["B2"]


def test_adding_waits_for_whoever_has_the_spool(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "waiting.jsonl")
    spool.add(Item(item_id="first"))
    other = os.open(spool.path, os.O_RDWR)
    fcntl.flock(other, fcntl.LOCK_EX)
    adding = threading.Thread(target=spool.add, args=(Item(item_id="second"),))
    adding.start()
    adding.join(0.3)
    waited = adding.is_alive()
    os.close(other)
    adding.join(30)
    assert waited
    assert len(spool.waiting()) == 2


def test_a_store_that_does_not_answer_holds_up_nobody_who_adds(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "waiting.jsonl")
    spool.add(Item(item_id="old"))
    asked, answered = threading.Event(), threading.Event()

    def write(record: object) -> None:
        asked.set()
        answered.wait(30)

    draining = threading.Thread(target=spool.drain, args=(write,))
    draining.start()
    assert asked.wait(30)
    adding = threading.Thread(target=spool.add, args=(Item(item_id="new"),))
    adding.start()
    adding.join(20)
    held_up = adding.is_alive()
    answered.set()
    draining.join(30)
    assert not held_up
    # What came meanwhile waits on; what was written does not.
    assert [record.item_id for record in spool.waiting()] == ["new"]


def test_a_file_is_on_the_disk_before_it_takes_its_place_and_so_is_its_name(
    tmp_path: Path, synced: list[tuple[int, int]]
) -> None:
    final = tmp_path / "pad.json"
    with atomic_path(final) as partial:
        partial.write_text("whole")
        inode = partial.stat().st_ino
    assert synced == [(inode, 5), (tmp_path.stat().st_ino, tmp_path.stat().st_size)]


def test_a_file_keeps_its_mode_and_a_link_stays_one(tmp_path: Path) -> None:
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


def test_a_writer_has_its_lock_from_the_start_and_a_reader_none(tmp_path: Path) -> None:
    path = tmp_path / "items.sqlite"
    Store.open(path).close()
    other = sqlite3.connect(path, timeout=0, isolation_level=None)
    with (
        transaction(path, writes=True),
        pytest.raises(sqlite3.OperationalError, match="locked"),
    ):
        other.execute("BEGIN IMMEDIATE")
    with transaction(path, writes=False):
        other.execute("BEGIN IMMEDIATE")
        other.execute("ROLLBACK")
    other.close()


def test_the_database_waits_for_the_disk(tmp_path: Path) -> None:
    with transaction(tmp_path / "items.sqlite", writes=False) as connection:
        asked = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar()
            for name in ("synchronous", "journal_mode", "foreign_keys")
        }
    assert asked == {"synchronous": 2, "journal_mode": "wal", "foreign_keys": 1}


def test_records_are_in_the_spool_before_the_store_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, spool = tmp_path / "items.sqlite", Spool(tmp_path / "waiting.jsonl")
    waiting: list[int] = []

    def ended(self: Store, item: Item) -> None:
        waiting.append(len(spool.waiting()))
        raise KeyboardInterrupt

    with Keeper(path, spool=spool) as keeper:
        with monkeypatch.context() as patched:
            patched.setattr(Store, "add_item", ended)
            with pytest.raises(KeyboardInterrupt):
                keeper.keep(Item(item_id="A17"))
        assert waiting == [1]
        assert keeper.keep(Item(item_id="B2"))
    with Store.open(path) as store:
        assert {item.item_id for item in store.items()} == {"A17", "B2"}


def test_what_the_store_refuses_is_told_and_kept_beside(tmp_path: Path) -> None:
    spool = Spool(tmp_path / "waiting.jsonl")
    orphan = Verdict(item_id="nobody", about=About.BIN, text="bin 1", given_at=TIME)
    with Keeper(tmp_path / "items.sqlite", spool=spool) as keeper:
        with pytest.raises(InputError, match="add that one first"):
            keeper.keep(orphan)
        assert keeper.keep(Item(item_id="A17"))
    assert spool.waiting() == ()
    assert "nobody" in spool.path.with_suffix(".refused").read_text()


def test_a_frozen_server_loses_no_grasp_and_hangs_nobody(
    postgresql_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import psycopg

    from palpate.produce.store import postgresql as store_postgresql

    monkeypatch.setattr(store_postgresql, "ANSWER_S", 0.3)
    url, spool = f"{postgresql_url}&connect_timeout=2", Spool(tmp_path / "waiting.jsonl")
    with psycopg.connect(postgresql_url) as admin, Keeper(url, spool=spool) as keeper:
        assert keeper.keep(Item(item_id="before"))
        backends = [
            row[0]
            for row in admin.execute(
                "SELECT pid FROM pg_stat_activity "
                "WHERE client_port = -1 AND pid <> pg_backend_pid()"
            )
        ]
        parent = int(Path(f"/proc/{backends[0]}/stat").read_text().rsplit(")", 1)[1].split()[1])
        frozen = [parent, *backends]
        for pid in frozen:
            os.kill(pid, signal.SIGSTOP)
        try:
            assert not keeper.keep(Item(item_id="frozen"))
            assert "no answer" in str(keeper.away)
            assert len(spool.waiting()) == 1
        finally:
            for pid in frozen:
                os.kill(pid, signal.SIGCONT)
        assert keeper.keep(Item(item_id="after"))
    with Store.open(postgresql_url) as store:
        assert {item.item_id for item in store.items()} == {"before", "frozen", "after"}
