"""`palpate calibrate force` with load cells from the first prompt to the saved file."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.commands import Command

from palpate.calibration import Calibration
from palpate.cli import calibrate_force
from palpate.clock import ManualClock
from palpate.force.of_calibration import contacts_of, sheet_law_of
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import draw_object
from palpate.twin.rig import FACES
from palpate.twin.world import World

pytestmark = pytest.mark.usefixtures("firmware_built")

#: Newtons per count and zero counts of the two load cells.
NEWTONS_PER_COUNT, ZEROS = (5e-6, -4e-6), (30_000, -70_000)
RIG = f"""
calibration = "pad.json"
[array]
open = "bench_of_the_test:array"
[gripper]
open = "bench_of_the_test:gripper"
[load_cells]
newtons_per_count = {list(NEWTONS_PER_COUNT)}
"""


class Bench:
    """A board, a gripper, two load cells and a user who follows the prompts."""

    def __init__(self) -> None:
        self.clock = ManualClock(50.0)
        self.world = World(None, seed=4, clock=self.clock, layout=RIGID_LAYOUT)
        self.board = FirmwareBoard(seed=1)
        self.stream = FirmwareStream(self.world, board=self.board)
        self.world.watchers.append(self._weigh)
        self.asked: list[str] = []
        self._faces = np.random.default_rng(7)
        self._weighing = False

    def array(self) -> SerialArray:
        return SerialArray(
            self.stream,
            clock=self.clock,
            layout=RIGID_LAYOUT,
            contents=Contents.LOAD_CELLS,
            rate_hz=self.world.frame_rate_hz,
            oversampling=self.world.oversampling,
        )

    def gripper(self) -> TwinGripper:
        return TwinGripper(self.world)

    def prompt(self, what: str, **_: object) -> str:
        self.asked.append(what)
        name = FACES[len(self.asked) % len(FACES)]
        self.world.place(draw_object(self._faces, name))
        self.clock.sleep_s(3.0)
        return ""

    def _weigh(self, time_s: float) -> None:
        # Reading the world's force calls its watchers and would recurse.
        if self._weighing:
            return
        self._weighing = True
        force_n = self.world.force_n(time_s)
        self._weighing = False
        for cell, (scale, zero) in enumerate(zip(NEWTONS_PER_COUNT, ZEROS, strict=True)):
            self.board.set_load(cell, zero + round(force_n / scale))


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bench = Bench()
    opened = SimpleNamespace(array=bench.array, gripper=bench.gripper)
    monkeypatch.setitem(sys.modules, "bench_of_the_test", opened)
    for module in ("rig.bench", "cli.calibrate_force"):
        monkeypatch.setattr(f"palpate.{module}.RealClock", lambda: bench.clock)
    monkeypatch.setattr("typer.prompt", bench.prompt)
    (tmp_path / "rig.toml").write_text(RIG)
    files = ("--rig", tmp_path / "rig.toml", "--out", tmp_path / "pad.json")
    bench.calibrate = ("calibrate", "force", *files)
    yield bench
    bench.stream.close()


def test_guided_force_calibration_refuses_a_pressure_gripper_before_any_movement(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    soft = World(None, seed=4, gripper="soft")
    monkeypatch.setattr(sys.modules["bench_of_the_test"], "gripper", lambda: TwinGripper(soft))
    error = palpate.refused(*bench.calibrate)
    assert "driven by pressure" in error
    assert "--loads" in error
    assert bench.asked == []


def test_guided_force_calibration_with_load_cells_measures_newtons(
    bench: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, palpate: Command
) -> None:
    # All steps with fewer placements, because half an hour of the board requires minutes.
    monkeypatch.setattr(calibrate_force, "HOLDS_N", ((0.8, 3.0), (1.5, 9.0), (0.8, 5.0)))
    document = palpate(*bench.calibrate, "--json").document
    assert [what.split(":")[0] for what in bench.asked] == [
        f"placement {number} of 3" for number in range(1, 4)
    ]
    assert document["pairs"] > 3
    assert "half_interval_percent" not in document
    made = Calibration.load(tmp_path / "pad.json")
    assert made.origin == "hardware"
    law, contacts = sheet_law_of(made), contacts_of(made.force, layout=made.layout)
    estimated_n = np.concatenate([law.read(states).force_n for states, _ in contacts])
    true_n = np.concatenate([force_n for _, force_n in contacts])
    firm = true_n > 1.0
    assert np.count_nonzero(firm) >= 8
    assert np.median(np.abs(np.log(estimated_n[firm] / true_n[firm]))) < 0.2
    # The board is closed, so its watcher must be removed.
    bench.world.watchers.remove(bench._weigh)
    assert bench.gripper().state().width_mm > 70.0
