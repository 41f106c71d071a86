"""No grasp is lost when the store is away, and none is written twice when it is back."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from palpate.errors import InputError, StoreError
from palpate.grasp.result import Outcome
from palpate.produce.records import About, Grasp, Item, Verdict
from palpate.produce.records_json import CalibrationText
from palpate.produce.store import Store
from palpate.produce.store import engine as store_engine
from palpate.produce.store.outbox import Keeper, Spool
from palpate.produce.store.writing import calibration_id_of

TIME = datetime(2026, 5, 1, 8, tzinfo=UTC)


@pytest.fixture(autouse=True)
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store_engine, "LOCK_TIMEOUT_S", 0.05)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "items.sqlite"


@pytest.fixture
def spool(tmp_path: Path) -> Spool:
    return Spool(tmp_path / "waiting.jsonl")


def grasp(item_id: str = "A17") -> Grasp:
    return Grasp(
        item_id=item_id,
        taken_at=TIME,
        rig="sim-rigid",
        drive="width",
        origin="twin",
        outcome=Outcome.HELD,
    )


@contextmanager
def locked(path: Path) -> Iterator[None]:
    connection = sqlite3.connect(path, isolation_level=None)
    connection.execute("BEGIN EXCLUSIVE")
    yield
    connection.execute("COMMIT")
    connection.close()


def test_what_waits_is_written_before_what_is_new(path: Path, spool: Spool) -> None:
    calibration = CalibrationText(content="the text")
    waiting = replace(grasp(), calibration_id=calibration_id_of("the text"))
    new = Verdict(item_id="A17", about=About.BIN, text="bin 1", given_at=TIME)
    with Keeper(path, spool=spool) as keeper:
        with locked(path):
            assert not keeper.keep(calibration, waiting)
            assert "locked by another program" in str(keeper.away)
            assert len(spool.waiting()) == 2
        # The verdict refers to an item that so far only waits.
        assert keeper.keep(new)
        assert keeper.away is None
    assert spool.waiting() == ()
    with Store.open(path) as store:
        assert store.grasps_of("A17") == (waiting,)
        assert store.verdicts_of("A17") == (new,)


def test_a_store_that_is_away_from_the_start_is_no_reason_to_stop(path: Path, spool: Spool) -> None:
    Store.open(path).close()
    taken = grasp()
    with locked(path), Keeper(path, spool=spool) as keeper:
        # A reader is let in beside a writer; it shows with the first write.
        assert not keeper.keep(taken)
    with Keeper(path, spool=spool):
        pass
    with Store.open(path) as store:
        assert store.grasps_of("A17") == (taken,)


def test_a_server_that_does_not_answer_is_waited_for(tmp_path: Path, spool: Spool) -> None:
    nowhere = f"postgresql://palpate@/items?host={tmp_path}"
    with Keeper(nowhere, spool=spool) as keeper:
        assert "no answer; check the server" in str(keeper.away)
        assert not keeper.keep(grasp())
    assert len(spool.waiting()) == 1


def test_a_drain_cut_short_repeats_without_harm(path: Path, spool: Spool) -> None:
    first, second = grasp("A"), grasp("B")
    spool.add(first, second)
    with Store.open(path) as store:
        store.add_grasp(first)
    with Keeper(path, spool=spool) as keeper:
        assert keeper.away is None
    with Store.open(path) as store:
        assert {item.item_id for item in store.items()} == {"A", "B"}
        assert store.grasps_of("A") == (first,)


def test_what_waiting_would_not_mend_is_refused_at_once(path: Path, spool: Spool) -> None:
    path.write_text("these are notes, and no database at all " * 50)
    with pytest.raises(StoreError, match="not a store"):
        Keeper(path, spool=spool)
    with pytest.raises(InputError, match="must be a file, or a URL"):
        Keeper("mysql://hall/items", spool=spool)


def test_a_store_that_breaks_meanwhile_costs_no_grasp(path: Path, spool: Spool) -> None:
    with Keeper(path, spool=spool) as keeper:
        assert keeper.keep(Item(item_id="A17"))
        # As a newer palpate might leave it.
        with sqlite3.connect(path) as connection:
            connection.execute("DROP TABLE measurements")
            connection.execute("ALTER TABLE grasps RENAME TO grasps_of_old")
        assert not keeper.keep(grasp())
    assert len(spool.waiting()) == 1


def test_stores_named_from_elsewhere_share_one_spool(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PALPATE_SPOOL", str(path.parent))
    monkeypatch.chdir(path.parent)
    with Keeper("items.sqlite") as here, Keeper(path) as there, Keeper("other.sqlite") as other:
        assert here.spool.path == there.spool.path
        assert other.spool.path != here.spool.path
