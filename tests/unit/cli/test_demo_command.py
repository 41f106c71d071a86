"""`palpate demo`: its files and suggested commands."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.commands import Command
from tests.pages import run_line

from palpate.cli.demo import NAMES
from palpate.produce.store import Store


@pytest.mark.slow
def test_demo_suggested_commands_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command, packhouse: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    shown = palpate("demo", "recordings").out
    assert "simulated" in shown
    palpate("demo", "force")
    shutil.copytree(packhouse, "demo-packhouse")
    # The commands of the robot need its running demo: `tests/loop/test_so101.py`.
    for _, suggested in (NAMES[name] for name in NAMES if name != "so101"):
        for line in suggested:
            assert run_line(line) == int("exit status 1" in line), line
    tables = sorted((tmp_path / "demo-recordings").glob("*.csv"))
    assert len(tables) == 3
    for table in tables:
        assert "simulated" in table.read_text(encoding="utf-8").splitlines()[0]


@pytest.mark.slow
def test_demo_packhouse_measures_every_fruit_on_the_twin(packhouse: Path, palpate: Command) -> None:
    with Store.open(packhouse / "palpate-items.sqlite", create=False) as store:
        fruits = store.items_of_batch("Monday")
        grasps = [store.grasps_of(fruit.item_id)[-1] for fruit in fruits]
    assert {grasp.origin for grasp in grasps} == {"twin"}
    for name in ("size_mm", "force_n", "settled_percent"):
        values = [grasp.measurements[name].value for grasp in grasps]
        assert len(set(values)) == len(fruits) == 6
    assert all(grasp.pixel_settled_percent is not None for grasp in grasps)
    assert "already exists" in palpate("demo", "packhouse", "--out", packhouse, status=2).err
