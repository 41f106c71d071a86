"""What waits for the store: whole after any crash, in order, once."""

from __future__ import annotations

import errno
import os
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from threading import Thread

import pytest
from tests.full_disk import file_size_limit

from palpate.errors import InputError, StoreAwayError
from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import About, Grasp, Item, Verdict
from palpate.produce.records_json import CalibrationText, StoreRecord
from palpate.produce.store.outbox import Spool, spool_path

TIME = datetime(2026, 5, 1, 8, tzinfo=UTC)
RECORDS: tuple[StoreRecord, ...] = (
    CalibrationText(content='{"rest": 1}\nand more'),
    Item(item_id="A17", kind="avocado", first_seen=TIME),
    Grasp(
        item_id="A17",
        taken_at=TIME,
        rig="sim-soft",
        drive="pressure",
        origin="twin",
        outcome=Outcome.SLIPPED,
        measurements={"force_n": Measurement(value=1.0, low=0.5, high=1.5, unit="n", level=0.8)},
        pixel_settled_percent=((-1.5, None),),
    ),
    Verdict(item_id="A17", about=About.BIN, text="bin 2", given_at=TIME, details={"rule": 3}),
)


@pytest.fixture
def spool(tmp_path: Path) -> Spool:
    return Spool(tmp_path / "deeper" / "waiting.jsonl")


def test_records_come_back_in_order_and_once(spool: Spool) -> None:
    spool.add(*RECORDS[:2])
    spool.add(*RECORDS[2:])
    assert spool.waiting() == RECORDS
    taken: list[StoreRecord] = []
    assert spool.drain(taken.append) == len(RECORDS)
    assert tuple(taken) == RECORDS
    assert spool.drain(taken.append) == 0


def test_nothing_waits_where_there_is_no_file(spool: Spool) -> None:
    assert spool.waiting() == ()
    assert spool.drain(print) == 0
    assert not spool.path.exists()


def test_a_line_cut_anywhere_costs_no_other(spool: Spool) -> None:
    spool.add(*RECORDS)
    whole = spool.path.read_bytes()
    first = len(b"".join(whole.splitlines(keepends=True)[:-1]))
    for end in range(first, len(whole) - 1):
        spool.path.write_bytes(whole[:end])
        assert spool.waiting() == RECORDS[:-1]
        spool.add(RECORDS[1])
        assert spool.waiting() == (*RECORDS[:-1], RECORDS[1])


def test_a_store_that_fails_half_way_leaves_everything_waiting(spool: Spool) -> None:
    spool.add(*RECORDS)
    taken: list[StoreRecord] = []

    def write(record: StoreRecord) -> None:
        if len(taken) == 2:
            raise StoreAwayError("no answer")
        taken.append(record)

    with pytest.raises(StoreAwayError):
        spool.drain(write)
    assert spool.waiting() == RECORDS


def test_what_can_never_be_written_is_put_aside_and_kept(spool: Spool) -> None:
    spool.add(*RECORDS)
    with spool.path.open("ab") as stream:
        stream.write(b"00000000 {half a li")

    def write(record: StoreRecord) -> None:
        if isinstance(record, Verdict):
            raise InputError("refers to nothing")

    assert spool.drain(write) == 3
    assert spool.waiting() == ()
    aside = spool.path.with_suffix(".refused").read_text()
    assert '"bin 2"' in aside
    assert "half a li" in aside


def test_a_disk_that_fills_up_leaves_the_file_as_it_was(
    spool: Spool, monkeypatch: pytest.MonkeyPatch
) -> None:
    spool.add(RECORDS[0])
    before = spool.path.read_bytes()
    write = os.write

    def full(descriptor: int, data: bytes) -> int:
        if len(data) < 60:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(descriptor, data[:50])

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(OSError, match="No space left"):
        spool.add(RECORDS[2])
    assert spool.path.read_bytes() == before


def test_spool_that_cannot_be_rewritten_loses_no_record(spool: Spool) -> None:
    spool.add(*RECORDS[:3])

    def write(record: StoreRecord) -> None:
        if record == RECORDS[0]:
            Spool(spool.path).add(RECORDS[3])
            full.enter_context(file_size_limit(50))

    with ExitStack() as full:
        assert spool.drain(write) == 3
    # What the store has is written once more, which does no harm.
    assert RECORDS[3] in spool.waiting()
    assert [file.name for file in spool.path.parent.iterdir()] == [spool.path.name]
    taken: list[StoreRecord] = []
    spool.drain(taken.append)
    assert RECORDS[3] in taken


def test_spool_drained_while_others_add_loses_nothing(spool: Spool) -> None:
    """A file that is replaced must not be added to by those that waited for it."""
    items = [Item(item_id=f"item {number}", first_seen=TIME) for number in range(200)]
    taken: set[StoreRecord] = set()
    adding = [
        Thread(target=lambda part=part: [Spool(spool.path).add(one) for one in items[part::2]])
        for part in range(2)
    ]
    for thread in adding:
        thread.start()
    while any(thread.is_alive() for thread in adding):
        spool.drain(taken.add)
    spool.drain(taken.add)
    assert taken == set(items)


def test_each_store_has_its_own_file_in_the_folder_that_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PALPATE_SPOOL", str(tmp_path))
    assert spool_path("store a").parent == tmp_path
    assert spool_path("store a") != spool_path("store b")
    monkeypatch.delenv("PALPATE_SPOOL")
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    assert spool_path("store a").parent == tmp_path / "state" / "palpate"
