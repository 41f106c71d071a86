"""Delivery of local records to the shared store: once, in order, after interruptions."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from queue import Queue

import pytest
import sqlalchemy as sa
from packages.station.tests.factories import make_grasp
from packages.station.tests.postgresql import PostgresqlProcess, programs
from tests.fixtures import skip
from tests.whole.test_json_schemas import faults

from palpate.errors import StoreAwayError, StoreError
from palpate.measurement import Measurement, Status
from palpate_station.dashboard.panel_history import item_html
from palpate_station.records import About, Grasp, Item, Verdict
from palpate_station.store import Store
from palpate_station.store import sender as store_sender
from palpate_station.store.item_history import AWAY_NOTE, item_document, read_item_history
from palpate_station.store.sender import Sender
from palpate_station.store.writing import calibration_id_of

TIME = datetime(2026, 5, 1, 8, tzinfo=UTC)
OpenStore = Callable[[str], AbstractContextManager[Store]]


@contextmanager
def station(monkeypatch: pytest.MonkeyPatch, folder: Path, url: str) -> Iterator[Store]:
    """Yield the store of a station with its own state folder and the shared server."""
    monkeypatch.setenv("XDG_STATE_HOME", str(folder))
    with Store.open(url) as store:
        yield store


@pytest.fixture
def open_store(postgresql_url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> OpenStore:
    """Return a function that opens the store of a named station."""
    return lambda name: station(monkeypatch, tmp_path / name, postgresql_url)


def grasp_after(item_id: str = "A17", *, hours: float = 0.0) -> Grasp:
    return make_grasp(item_id, taken_at=TIME + timedelta(hours=hours))


@contextmanager
def local_file(store: Store) -> Iterator[sqlite3.Connection]:
    path = store.local_name.removeprefix("store ")
    with closing(sqlite3.connect(path)) as connection, connection:
        yield connection


def count_waiting(store: Store) -> int:
    with local_file(store) as connection:
        (found,) = connection.execute("SELECT count(*) FROM outbox").fetchone()
    return int(found)


@pytest.mark.slow
def test_shared_store_history_contains_grasps_of_every_station(open_store: OpenStore) -> None:
    with open_store("one") as one, open_store("two") as two:
        first, second = grasp_after(), grasp_after(hours=1)
        one.add_grasp(replace(first, calibration_id=calibration_id_of("x")), calibration="x")
        one.add_item(Item(item_id="A17", kind="avocado"))
        assert [g.grasp_id for g in one.grasps_of("A17")] == [first.grasp_id]
        two.add_grasp(second)
        for store in (two, one):
            found = [g.grasp_id for g in store.grasps_of("A17")]
            assert found == [first.grasp_id, second.grasp_id]
            assert store.item("A17").kind == "avocado"
            assert store.calibration(calibration_id_of("x")) == "x"
            assert store.away is None


def test_verdict_on_a_grasp_from_another_station_is_stored(open_store: OpenStore) -> None:
    taken = replace(grasp_after(), calibration_id=calibration_id_of("x"))
    verdict = Verdict(
        item_id="A17", about=About.RIPENESS, text="ripe", given_at=TIME, grasp_id=taken.grasp_id
    )
    with open_store("one") as one:
        one.add_grasp(taken, calibration="x")
        one.send()
    with open_store("two") as two:
        assert two.add_verdict(verdict)
        assert two.send() == 1
    with open_store("one") as one:
        assert one.verdicts_of("A17") == (verdict,)
        assert one.grasps_of("A17") == (taken,)


def test_add_item_preserves_columns_set_by_another_station(open_store: OpenStore) -> None:
    with open_store("one") as one, open_store("two") as two:
        one.add_item(Item(item_id="A17", kind="avocado", batch="Monday", first_seen=TIME))
        one.send()
        two.add_item(Item(item_id="A17", kind="kiwi"))
        two.send()
        one.add_item(Item(item_id="A17", label="dark"))
        expected = Item(item_id="A17", kind="kiwi", batch="Monday", label="dark", first_seen=TIME)
        assert one.item("A17") == expected


@pytest.mark.slow
def test_send_repeated_records_are_stored_once(open_store: OpenStore) -> None:
    taken = [grasp_after(hours=n) for n in range(450)]
    with open_store("one") as store:
        store.add_grasps(taken)
        with local_file(store) as connection:
            rows = connection.execute("SELECT * FROM outbox").fetchall()
        assert store.send() == 450
        # Restore the rows, as after a lost acknowledgement.
        with local_file(store) as connection:
            connection.executemany("INSERT INTO outbox VALUES (?, ?, ?, ?)", rows)
        assert store.send() == 450
        assert list(store.grasps()) == taken


def test_local_store_without_server_has_empty_outbox(tmp_path: Path) -> None:
    with Store.open(tmp_path / "items.sqlite") as store:
        store.add_grasp(grasp_after())
        assert store.send() == 0
        assert count_waiting(store) == 0


def test_open_with_invalid_state_folder_raises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "file"))
    with pytest.raises(StoreError, match=r"can't be created .* set .* to another folder"):
        Store.open(f"postgresql://palpate@/items?host={tmp_path}")


@pytest.fixture
def postgresql_process() -> Iterator[PostgresqlProcess]:
    found = programs()
    if found is None:
        skip("no PostgreSQL server; install it (Debian: postgresql)")
    else:
        with PostgresqlProcess(found) as running:
            yield running


@pytest.mark.slow
def test_server_restart_loses_no_record_and_preserves_order(
    postgresql_process: PostgresqlProcess, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store_sender, "_RETRY_S", 0.05)
    errors: Queue[str] = Queue()
    grasps = [grasp_after(hours=n) for n in range(60)]
    with station(monkeypatch, tmp_path, postgresql_process.url) as store:
        store.add_grasps(grasps[:20])
        assert len(store.grasps_of("A17")) == 20
        postgresql_process.stop()
        for grasp in grasps[20:40]:
            store.add_grasp(grasp)
        with pytest.raises(StoreAwayError, match=r"no answer|connection was lost"):
            store.send()
        assert store.grasps_of("A17") == tuple(grasps[:40]), "from the local file"
        document = item_document(read_item_history(store, "A17"))
        assert document["away"] == AWAY_NOTE
        assert faults("item", document) == []
        assert AWAY_NOTE in item_html(read_item_history(store, "A17"))
    with Sender(postgresql_process.url, on_error=errors.put, on_return=errors.put) as sender:
        assert "records wait in the local store" in errors.get(timeout=60)
        postgresql_process.start()
        # Each new reason is reported, such as the server's start.
        while "answers again, 20 records sent" not in errors.get(timeout=60):
            pass
        with Store.open(postgresql_process.url) as store:
            store.add_grasps(grasps[40:])
        sender.wake()
    with Store.open(postgresql_process.url) as store:
        assert store.send() == count_waiting(store) == 0
        assert list(store.grasps()) == grasps
        assert store.away is None
        assert "away" not in item_document(read_item_history(store, "A17"))


@pytest.mark.slow
@pytest.mark.system
@pytest.mark.parametrize("version", [1, 2, 3])
def test_older_server_is_migrated_with_its_grasps(version: int, postgresql_url: str) -> None:
    with Store.open(postgresql_url) as store:
        store.add_grasps([make_grasp("A17")])
        store.send()
    engine = sa.create_engine(postgresql_url.replace("postgresql:", "postgresql+psycopg:"))
    with engine.begin() as connection:
        connection.execute(sa.text("ALTER TABLE measurements ALTER COLUMN value SET NOT NULL"))
        if version == 3:
            connection.execute(sa.text("UPDATE grasps SET firmness_force_n = 2.0"))
        else:
            for column in ("firmness_force_n", *(["station"] if version == 1 else [])):
                connection.execute(sa.text(f"ALTER TABLE grasps DROP COLUMN {column}"))
            row = "(1, 'firmness_force_n', 2.0, 2.0, 2.0, 0.9, 'ok')"
            connection.execute(sa.text(f"INSERT INTO measurements VALUES {row}"))
        connection.execute(sa.text(f"UPDATE palpate_schema SET version = {version}"))
    engine.dispose()
    with Store.open(postgresql_url) as store:
        bound = Measurement(value=None, low=1.5, high=9.0, unit="n_per_mm", status=Status.AT_LEAST)
        measured = {"stiffness_n_per_mm": bound}
        store.add_grasps([replace(make_grasp("A18"), station="line 1", measurements=measured)])
        assert store.send() == 1
        assert dict(store.grasps_of("A18")[0].measurements) == measured
        found = {one.item_id: (one.station, one.firmness_force_n) for one in store.grasps()}
        assert found == {"A17": (None, 2.0), "A18": ("line 1", None)}
        assert store.away is None
