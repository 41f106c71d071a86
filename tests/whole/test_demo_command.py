"""`palpate demo`: its files and suggested commands."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from xml.etree import ElementTree

import pytest
from tests.commands import Command
from tests.pages import run_line

from palpate.demo import DEMOS
from palpate_station.cli.demo import PACKHOUSE
from palpate_station.store import Store


@pytest.mark.slow
def test_demo_suggested_commands_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command, packhouse: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    shown = palpate("demo", "recordings").out
    assert "simulated" in shown
    palpate("demo", "force")
    palpate("demo")
    shutil.copytree(packhouse, "demo-packhouse")
    # The commands of the robot need its running demo: `tests/loop/test_so101.py`.
    files = [demo for demo in DEMOS.values() if not demo.is_running]
    for suggested in (one.commands for one in (*files, PACKHOUSE)):
        for line in suggested:
            assert run_line(line) == int("exit status 1" in line), line
    tables = sorted((tmp_path / "demo-recordings").glob("*.csv"))
    assert len(tables) == 3
    for table in tables:
        assert "simulated" in table.read_text(encoding="utf-8").splitlines()[0]


@pytest.mark.slow
def test_demo_without_a_name_shows_a_grasp_and_writes_its_picture(
    tmp_path: Path, palpate: Command
) -> None:
    out = tmp_path / "new" / "folder"
    for _ in range(2):  # a second demo replaces the files of the first
        shown = palpate("demo", "--out", out).out
    lines = re.findall(r"^ *([\d.]+) s  (\w+) +[\d.]+ mm  ([\d.]+) N", shown, re.MULTILINE)
    assert [*dict.fromkeys(phase for _, phase, _ in lines)] == [
        *("approach", "squeeze", "settle", "hold")
    ]
    # The force ends near the 3 N asked for.
    assert 2.5 < float(lines[-1][2]) < 3.5
    assert "SIMULATED" in shown
    assert "Held and released" in shown
    assert (out / "grasp.mcap").stat().st_size > 10_000
    picture = ElementTree.parse(out / "grasp.svg")
    drawn = [element.tag.rpartition("}")[2] for element in picture.iter()]
    assert {"polygon", "polyline", "animate"} <= {*drawn}
    assert "simulated" in "".join(picture.getroot().itertext())


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
