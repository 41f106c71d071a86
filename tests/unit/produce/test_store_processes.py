"""Ten processes write at once, and some are killed: nothing that was acknowledged is lost."""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from palpate.produce.store import Store
from palpate.produce.store.outbox import Keeper

WRITER = Path(__file__).with_name("store_writer.py")
KILLS = 20
WRITERS, GRASPS = 10, 10


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.setenv("PALPATE_SPOOL", str(tmp_path / "spool"))
    if request.param == "sqlite":
        return str(tmp_path / "items.sqlite")
    named: str = request.getfixturevalue("postgresql_url")
    return named


def start(url: str, *, processes: int, grasps: int) -> subprocess.Popen[str]:
    arguments = [sys.executable, str(WRITER), url, str(processes), str(grasps)]
    return subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)


def written(url: str) -> set[str]:
    """Return every grasp in the store, those that waited included; each with its measurement."""
    with Keeper(url) as keeper:
        assert keeper.away is None
    with Store.open(url, create=False) as store:
        grasps = list(store.grasps())
    assert all("stiffness_n_per_mm" in grasp.measurements for grasp in grasps)
    ids = [grasp.grasp_id for grasp in grasps]
    assert len(ids) == len(set(ids))
    return set(ids)


def test_ten_processes_that_begin_with_no_store_lose_nothing(url: str) -> None:
    writers = start(url, processes=WRITERS, grasps=GRASPS)
    out, _ = writers.communicate(timeout=120)
    assert writers.returncode == 0
    said = {line.split()[1] for line in out.splitlines()}
    assert len(said) == WRITERS * GRASPS
    assert written(url) == said
    with Store.open(url) as store:
        assert len(store.grasps_of("shared")) == WRITERS * GRASPS / 2


def test_killed_while_writing(url: str) -> None:
    rng = random.Random(0)
    writers = start(url, processes=KILLS, grasps=100_000)
    said: set[str] = set()
    lines_left: dict[int, int] = {}
    assert writers.stdout is not None
    # Each has the end of the pipe open until it is killed.
    for line in writers.stdout:
        pid, grasp_id = line.split()
        said.add(grasp_id)
        left = lines_left.setdefault(int(pid), rng.randint(1, 6)) - 1
        lines_left[int(pid)] = left
        if left == 0:
            os.kill(int(pid), signal.SIGKILL)
    writers.stdout.close()
    writers.wait(timeout=60)
    assert len(lines_left) == KILLS
    found = written(url)
    assert said <= found
    # At most the one that each was writing when it was killed.
    assert len(found - said) <= KILLS
    if not url.startswith("postgresql"):
        with sqlite3.connect(url) as connection:
            assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
