"""A backup contains every grasp acknowledged before it, also while others write."""

from __future__ import annotations

import sqlite3
from pathlib import Path

import pytest
from packages.station.tests.cli.stored import stored_grasp
from packages.station.tests.produce.test_store_processes import read_grasp_ids, start_writers
from tests.commands import Command

from palpate_station.store import Store


@pytest.mark.slow
def test_backup_during_writing_has_all_acknowledged_grasps_and_is_restored(
    tmp_path: Path, palpate: Command
) -> None:
    store = str(tmp_path / "items.sqlite")
    Store.open(store).close()
    acknowledged: list[str] = []
    with start_writers(store, processes=2, grasps=40) as writers:
        for number in range(3):
            acknowledged += [writers.stdout.readline().split()[1] for _ in range(5)]
            backup = tmp_path / f"backup-{number}.sqlite"
            palpate("items", "--store", store, "--backup", backup)
            found = read_grasp_ids(str(backup))
            assert set(acknowledged) <= found
            assert [one.name for one in tmp_path.glob("backup-*-wal")] == []
        writers.communicate()
    last = tmp_path / "last.sqlite"
    palpate("items", "--store", store, "--backup", last)
    restored = tmp_path / "restored.sqlite"
    palpate("items", "--store", restored, "--restore", last)
    assert read_grasp_ids(str(restored)) == read_grasp_ids(store)
    assert len(read_grasp_ids(str(restored))) == 80


def test_restore_never_replaces_a_store_and_refuses_other_files(
    tmp_path: Path, palpate: Command
) -> None:
    store, backup = tmp_path / "items.sqlite", tmp_path / "backup.sqlite"
    with Store.open(store) as opened:
        opened.add_grasps([stored_grasp("A17", {"stiffness_n_per_mm": 3.0}, hours=0)])
    palpate("items", "--store", store, "--backup", backup)
    assert str(backup) in palpate.refused("items", "--store", store, "--backup", backup)
    refused = palpate.refused("items", "--store", store, "--restore", backup)
    assert "items.sqlite exists" in refused
    other, damaged = tmp_path / "other.sqlite", tmp_path / "damaged.sqlite"
    sqlite3.connect(other).execute("CREATE TABLE fruit (name TEXT)").connection.close()
    raw = bytearray(backup.read_bytes())
    raw[4096 * 2 : 4096 * 4] = bytes(4096 * 2)
    damaged.write_bytes(raw)
    for file in (other, damaged, tmp_path / "missing.sqlite"):
        new = tmp_path / "new.sqlite"
        palpate.refused("items", "--store", new, "--restore", file)
        assert not new.exists()
