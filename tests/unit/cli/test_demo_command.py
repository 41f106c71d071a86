"""`palpate demo`: its files and suggested commands."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.produce.store import Store


@pytest.mark.slow
@pytest.mark.parametrize("name", ["recordings", "packhouse"])
def test_demo_suggested_commands_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    shown = palpate("demo", name).out
    assert "simulated" in shown
    suggested = shown.split("Try:\n")[1].splitlines()
    assert suggested
    for line in suggested:
        program, *arguments = shlex.split(line, comments=True)
        if program == "cd":
            os.chdir(arguments[0])
            continue
        palpate(*arguments, status=int("exit status 1" in line))


@pytest.mark.slow
def test_demo_into_an_existing_store_is_refused(packhouse: Path, palpate: Command) -> None:
    assert "already exists" in palpate("demo", "packhouse", "--out", packhouse, status=2).err


def test_demo_packhouse_measures_every_fruit_on_the_twin(packhouse: Path) -> None:
    with Store.open(packhouse / "palpate-items.sqlite", create=False) as store:
        fruits = store.items_of_batch("Monday")
        grasps = [store.grasps_of(fruit.item_id)[-1] for fruit in fruits]
    assert {grasp.origin for grasp in grasps} == {"twin"}
    for name in ("size_mm", "force_n", "settled_percent"):
        values = [grasp.measurements[name].value for grasp in grasps]
        assert len(set(values)) == len(fruits) == 6
    assert all(grasp.pixel_settled_percent is not None for grasp in grasps)


@pytest.mark.slow
def test_recordings_are_labelled_simulated(tmp_path: Path, palpate: Command) -> None:
    palpate("demo", "recordings", "--out", tmp_path)
    tables = sorted(tmp_path.glob("*.csv"))
    assert len(tables) == 3
    for table in tables:
        assert "simulated" in table.read_text(encoding="utf-8").splitlines()[0]


def test_demo_of_an_unknown_name_lists_the_demos(palpate: Command) -> None:
    assert "recordings, packhouse" in palpate("demo", "circus", status=2).err
