"""Unusable stores: one-line messages and exit statuses."""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy as sa
from packages.station.tests.factories import make_grasp

from palpate.errors import InputError, MissingExtraError, PalpateError, StoreAwayError, StoreError
from palpate.measurement import Measurement
from palpate_station.cli.items import open_store
from palpate_station.dashboard.item_store import ItemStore
from palpate_station.records import About, Item, Verdict
from palpate_station.store import Store
from palpate_station.store import engine as store_engine
from palpate_station.store.engine import make_engine, show_url, store_url
from palpate_station.store.export import require_parquet
from palpate_station.store.item_history import read_item_histories

SCHEMA_1 = Path(__file__).parents[1] / "golden" / "store" / "schema-1.sql"
SEEN = datetime(2026, 5, 1, tzinfo=UTC)
FORCE = Measurement(value=1.0, low=0.5, high=1.5, unit="n", level=0.8)


@pytest.fixture(autouse=True)
def short_lock_timeout(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(store_engine, "LOCK_TIMEOUT_S", 0.05)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    found = tmp_path / "items.sqlite"
    with Store.open(found) as store:
        store.add_item(Item(item_id="A17", first_seen=SEEN))
    return found


@pytest.fixture
def without_root() -> Iterator[Path]:
    """Drop root privileges, which override file permissions; yield a private folder."""
    folder = Path(tempfile.mkdtemp(prefix="palpate-store-"))
    user = os.geteuid()
    if user == 0:
        shutil.chown(folder, 65534)
        os.seteuid(65534)
    yield folder
    os.seteuid(user)
    folder.chmod(0o700)
    shutil.rmtree(folder)


def open_and_write(where: str | Path) -> None:
    with Store.open(where) as store:
        store.add_item(Item(item_id="B2"))
        store.send()


def test_locked_store_refuses_a_writer_and_does_not_block_a_reader(path: Path) -> None:
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        with pytest.raises(StoreAwayError, match=r"items.sqlite: locked by another .* for 0.05"):
            open_and_write(path)
        with Store.open(path, create=False) as store:
            assert store.item("A17").first_seen == SEEN


@pytest.fixture
def filled(path: Path) -> Path:
    """Add a grasp and a verdict."""
    with Store.open(path) as store:
        store.add_grasp(make_grasp(taken_at=SEEN, measurements={"force_n": FORCE}))
        given = {"about": About.BIN, "text": "bin 2", "given_at": SEEN, "details": {}}
        store.add_verdict(Verdict(item_id="A17", **given))
    return path


@pytest.mark.parametrize(
    "damage",
    [
        "sqlite_master SET sql = CAST(x'ff00c9' AS TEXT) WHERE name = 'items'",
        "sqlite_master SET sql = replace(sql, 'kind', 'x') WHERE name = 'items'",
        "sqlite_master SET rootpage = 99 WHERE name = 'items'",
        "items SET first_seen = '2026-0A-01'",
        "items SET kind = x'ff'",
        "items SET kind = CAST(x'c9' AS TEXT)",
        "grasps SET outcome = 'heId'",
        "grasps SET pixel_settled_percent = '{'",
        "grasps SET pixel_settled_percent = '7'",
        "grasps SET height_mm = x'ff'",
        "measurements SET name = 'farce_n'",
        "measurements SET status = 7",
        "verdicts SET source = 'Dalpate'",
        "verdicts SET details = ''",
    ],
)
def test_read_damaged_content_raises_one_line(filled: Path, damage: str) -> None:
    with closing(sqlite3.connect(filled, isolation_level=None)) as other:
        other.execute("PRAGMA writable_schema = ON")
        other.execute(f"UPDATE {damage}")
    with (
        pytest.raises(PalpateError, match=r"items\.sqlite|not a|must") as caught,
        Store.open(filled) as store,
    ):
        read_item_histories(store, store.items())
    assert "\n" not in str(caught.value)


def test_read_ignores_obsolete_measurement(filled: Path) -> None:
    with closing(sqlite3.connect(filled, isolation_level=None)) as other:
        other.execute(
            "INSERT INTO measurements SELECT grasp_number, 'firmness_n_per_mm', value, low, "
            "high, level, status FROM measurements"
        )
    with Store.open(filled) as store:
        assert dict(next(iter(store.grasps())).measurements) == {"force_n": FORCE}


@pytest.mark.parametrize("folder_mode", [0o755, 0o555])
def test_read_only_store_is_readable_and_refuses_writes(
    without_root: Path, folder_mode: int
) -> None:
    path = without_root / "items of #3?.sqlite"
    with Store.open(path) as store:
        store.add_item(Item(item_id="A17", first_seen=SEEN))
    path.chmod(0o444)
    without_root.chmod(folder_mode)
    with open_store(str(path)) as store:
        assert store.item("A17").first_seen == SEEN
        with pytest.raises(StoreError, match="read-only; change the permissions of the file"):
            store.add_item(Item(item_id="B2"))
    assert [page.item.item_id for page in ItemStore(str(path)).pages(limit=9)] == ["A17"]
    # Opening for writing also fails, so no gripper moves without a writable store.
    with pytest.raises(StoreError, match="read-only; change the permissions of the file"):
        open_and_write(path)


def test_read_only_store_of_older_schema_is_readable(without_root: Path) -> None:
    path = without_root / "items.sqlite"
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(SCHEMA_1.read_text())
        connection.execute(
            "INSERT INTO measurements VALUES (1, 'firmness_force_n', 2.0, 2.0, 2.0, 0.9, 'ok')"
        )
        connection.commit()
    path.chmod(0o444)
    without_root.chmod(0o555)
    with open_store(str(path)) as store:
        assert [item.item_id for item in store.items()] == ["A17"]
        assert list(store.grasps()) == list(store.grasps_of("A17"))
        assert [(one.station, one.firmness_force_n) for one in store.grasps()] == [(None, 2.0)]


def test_open_read_only_with_leftover_wal_file_raises(without_root: Path) -> None:
    path = without_root / "items.sqlite"
    helper = Path(f"{path}-wal")
    Store.open(path).close()
    with Store.open(path) as store:
        store.add_item(Item(item_id="A17", first_seen=SEEN))
        left = helper.read_bytes()
        before = path.read_bytes()
    # Restore the state after a killed process.
    path.write_bytes(before)
    helper.write_bytes(left)
    without_root.chmod(0o555)
    with pytest.raises(StoreError, match="can't be opened"):
        Store.open(path, create=False)


def test_store_open_in_read_only_folder_raises(without_root: Path) -> None:
    without_root.chmod(0o555)
    with pytest.raises(StoreError, match="can't be opened; check the folder and its permissions"):
        Store.open(without_root / "items.sqlite")


def test_store_write_to_full_disk_raises_and_store_stays_readable(path: Path) -> None:
    engine = make_engine(store_url(path))

    def limit_pages(connection: Any, record: object) -> None:
        del record
        connection.execute("PRAGMA max_page_count = 1")

    sa.event.listen(engine, "connect", limit_pages)
    with Store(engine, name="store items.sqlite") as store:
        with pytest.raises(StoreAwayError, match="the disk is full; make room"):
            store.add_calibration("long " * 10_000)
        assert store.item("A17").first_seen == SEEN


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"fruit, size\nkiwi, 48\n" * 200, "not a store \\(no SQLite database\\)"),
        (b"SQLite format 3\x00" + b"\x07" * 4096, "not a store|damaged"),
        (None, r"is damaged; restore it from a backup"),
    ],
)
def test_open_foreign_or_damaged_file_raises_and_preserves_the_file(
    path: Path, content: bytes | None, message: str
) -> None:
    if content is None:
        whole = path.read_bytes()
        content = whole[:4096] + b"\x5a" * (len(whole) - 4096)
    path.write_bytes(content)
    with pytest.raises(StoreError, match=f"items.sqlite: .*({message})"):
        Store.open(path)
    assert path.read_bytes() == content


@pytest.mark.parametrize(
    ("name", "create", "message"),
    [
        ("none.sqlite", False, "no such file; `palpate grasp --item NAME --store FILE`"),
        ("none/items.sqlite", True, "the folder .* does not exist"),
        ("", True, "is a folder; name a file in it"),
    ],
)
def test_open_missing_file_or_folder_raises(
    tmp_path: Path, name: str, create: bool, message: str
) -> None:
    with pytest.raises(StoreError, match=message):
        Store.open(tmp_path / name, create=create)
    assert not (tmp_path / "none.sqlite").exists()


@pytest.mark.parametrize("url", ["mysql://hall/items", "oracle://x", "://", "http://hall/items"])
def test_open_url_of_another_database_raises(url: str) -> None:
    with pytest.raises(InputError, match="store "):
        Store.open(url)


def test_store_url_default_is_the_variable_or_a_local_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PALPATE_STORE", "postgresql://packer:secret@hall3/items")
    assert show_url(store_url(None)) == "store postgresql://packer:***@hall3/items"
    monkeypatch.delenv("PALPATE_STORE")
    monkeypatch.chdir(tmp_path)
    Store.open().close()
    assert (tmp_path / "palpate-items.sqlite").exists()


@pytest.mark.slow
def test_server_without_database_or_user_raises(postgresql_server: str) -> None:
    url = f"postgresql://postgres@/{{}}?host={postgresql_server}"
    with pytest.raises(StoreError, match="no such database on the server") as caught:
        open_and_write(url.format("nothing_here"))
    assert caught.value.exit_status == 2
    with pytest.raises(StoreError, match="the server refused the user or password"):
        open_and_write(f"postgresql://nobody@/postgres?host={postgresql_server}")


def test_server_without_answer_raises_one_line_without_password(tmp_path: Path) -> None:
    with pytest.raises(StoreAwayError, match="no answer; check the server") as away:
        open_and_write(f"postgresql://palpate:secret@/items?host={tmp_path}")
    assert away.value.exit_status == 3
    assert "secret" not in str(away.value)
    assert "\n" not in str(away.value)


def test_store_write_to_read_only_server_raises(postgresql_url: str) -> None:
    open_and_write(postgresql_url)
    separator = "%20-c%20default_transaction_read_only=on"
    with pytest.raises(StoreError, match="read-only; name the primary server"):
        open_and_write(f"{postgresql_url}{separator}")


def test_locked_server_table_raises_store_away_error(postgresql_url: str) -> None:
    open_and_write(postgresql_url)
    engine = make_engine(store_url(postgresql_url))
    with engine.begin() as connection:
        connection.exec_driver_sql("LOCK TABLE items IN ACCESS EXCLUSIVE MODE")
        with pytest.raises(StoreAwayError, match=r"locked by another program for 0\.05 s"):
            open_and_write(postgresql_url)
    engine.dispose()


def test_store_reconnects_after_the_server_closed_the_connection(postgresql_url: str) -> None:
    with Store.open(postgresql_url) as store:
        engine = make_engine(store_url(postgresql_url))
        with engine.begin() as connection:
            connection.exec_driver_sql(
                "SELECT pg_terminate_backend(pid) FROM pg_stat_activity "
                "WHERE pid <> pg_backend_pid() AND datname = current_database()"
            )
        # The pool detects the closed connection and reconnects.
        store.add_item(Item(item_id="A17"))
        assert [item.item_id for item in store.items()] == ["A17"]
        engine.dispose()


@pytest.mark.parametrize(
    ("package", "extra", "use"),
    [
        ("psycopg", "palpate-station[postgresql]", lambda: Store.open("postgresql://hall3/items")),
        ("pyarrow", "palpate[data]", require_parquet),
    ],
)
def test_missing_package_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, package: str, extra: str, use: Callable[[], object]
) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(MissingExtraError, match=re.escape(f"pip install '{extra}'")):
        use()
