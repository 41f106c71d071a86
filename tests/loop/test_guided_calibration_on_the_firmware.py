"""`palpate calibrate force` from the first prompt to the saved file, on the firmware."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import typer

from palpate.calibrate.laws import HORIZON_S, placements_of
from palpate.cli import calibrate_force, calibrate_rest, run
from palpate.clock import ManualClock
from palpate.estimate.pixel_law import fit_laws
from palpate.gripper.interface import GripperCommand
from palpate.rig.simulated import FACES
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.calibration import Calibration
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard, FirmwareStream
from palpate.twin.objects import TwinObject, draw_object
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
        self._plug_in()
        self.asked: list[str] = []
        self._faces = np.random.default_rng(7)
        self._weighing = False
        self._pressed: TwinObject | None = None
        self._width_mm = 74.0

    def _plug_in(self) -> None:
        self.board = FirmwareBoard(seed=1)
        self.stream = FirmwareStream(self.world, board=self.board)
        self.world.watchers.append(self._weigh)

    def plug_in_again(self) -> None:
        """Reconnect: the previous command has closed the port and thus the simulated board."""
        self.world.watchers.clear()
        self._plug_in()

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
        if laid := re.match(r"place (\S+) N on the pad", what):
            self._press(float(laid[1]))
            return ""
        name = FACES[len(self.asked) % len(FACES)]
        self.world.place(draw_object(self._faces, name))
        self.clock.sleep_s(3.0)
        return ""

    def _press(self, load_n: float) -> None:
        """Close until the pad carries the load of a weight, with a simulated relaxation."""
        gripper, clock = self.gripper(), self.clock
        if self._pressed is None:
            self._pressed = draw_object(np.random.default_rng(1), "ecoflex-10")
            self.world.place(self._pressed)
            self._width_mm = self._pressed.size_mm + 1.0
            gripper.command(GripperCommand(target=self._width_mm, rate=40.0))
            clock.sleep_s(3.0)
        while abs(self.world.force_n(clock.now_s()) - load_n) > 0.05 * load_n:
            less = self.world.force_n(clock.now_s()) > load_n
            self._width_mm += 0.03 if less else -0.03
            gripper.command(GripperCommand(target=self._width_mm, rate=20.0))
            clock.sleep_s(0.05)

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
    yield bench
    bench.stream.close()


def calibrate(
    folder: Path, *more: str, step: Callable[..., None] = calibrate_force.calibrate_force
) -> int:
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command()(step)
    arguments = ("--rig", str(folder / "rig.toml"), "--out", str(folder / "pad.json"), *more)
    return run(app, arguments, name="palpate calibrate")


def test_guided_force_calibration_refuses_a_pressure_gripper_before_any_movement(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    soft = World(None, seed=4, gripper="soft")
    monkeypatch.setattr(sys.modules["bench_of_the_test"], "gripper", lambda: TwinGripper(soft))
    assert calibrate(tmp_path) == 2
    error = capsys.readouterr().err
    assert "driven by pressure" in error
    assert "--loads" in error
    assert error.count("\n") == 1
    assert bench.asked == []


def test_three_weights_narrow_the_interval_and_a_load_cell_replaces_the_calibration(
    bench: Bench,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert calibrate(tmp_path, step=calibrate_rest.calibrate_rest) == 0
    bench.plug_in_again()
    loads = tmp_path / "loads.csv"
    loads.write_text("load_n\n1.5\n4\n9\n")
    capsys.readouterr()
    assert calibrate(tmp_path, "--loads", str(loads), "--json") == 0
    document = json.loads(capsys.readouterr().out)
    halves = document["half_interval_percent"]
    assert len(halves) == 3
    assert all(each["after"] < 0.1 * each["before"] for each in halves.values())
    assert document["pairs"] == 3
    bench.plug_in_again()
    by_weights = Calibration.load(tmp_path / "pad.json")
    assert by_weights.force.force_n == (1.5, 4.0, 9.0)

    # All steps with fewer placements, because half an hour of the board requires minutes.
    monkeypatch.setattr(calibrate_force, "HOLDS_N", ((0.8, 3.0), (1.5, 9.0), (0.8, 5.0)))
    bench.asked.clear()
    assert calibrate(tmp_path, "--json") == 0
    assert [what.split(":")[0] for what in bench.asked] == [
        f"placement {number} of 3" for number in range(1, 4)
    ]
    document = json.loads(capsys.readouterr().out)
    assert document["pairs"] > 3
    assert "half_interval_percent" not in document
    made = Calibration.load(tmp_path / "pad.json")
    assert made.origin == "hardware"
    reading, early, settled = fit_laws(placements_of(made.force))
    settled_then = np.isclose(made.force.since_move_s, HORIZON_S)
    excess = reading.reading(np.array(made.force.pixel_excess)[:, None, :])
    estimated_n = np.where(settled_then, settled.force_n(excess).value, early.force_n(excess).value)
    true_n = np.array(made.force.force_n)
    firm = true_n > 1.0
    assert np.count_nonzero(firm) >= 8
    assert np.median(np.abs(np.log(estimated_n[firm] / true_n[firm]))) < 0.2
    # The board is closed, so its watcher must be removed.
    bench.world.watchers.remove(bench._weigh)
    assert bench.gripper().state().width_mm > 70.0
