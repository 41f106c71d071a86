"""`palpate calibrate` with the load cells of a board from a rig file."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from tests.commands import Command
from tests.unit.rig.test_board_cell import Desk

from palpate.calibrate.rest import replace_rest
from palpate.calibration import Calibration, RestValues
from palpate.cli.calibrate_bench import has_load_cell
from palpate.sensor.array import RIGID_LAYOUT
from palpate.sensor.serial_array import SerialArray
from palpate.twin.devices import TwinGripper, TwinLoadCell
from palpate.twin.objects import draw_object
from palpate.twin.world import World

TABLES = (
    'calibration = "pad.json"\n[array]\nopen = "desk_of_the_test:array"\n'
    '[gripper]\nopen = "desk_of_the_test:gripper"\n'
)


class Bench(Desk):
    """The desk with a gripper and a user who follows the prompts."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self.world = World(None, seed=4, clock=self.clock)
        self.rig = folder / "rig.toml"
        self.prompts: list[str] = []
        self.react: Callable[[str], None] = lambda instruction: None
        self.array.close()

    def reopen_array(self) -> SerialArray:
        """Return the array of one more command, which closes it."""
        self.array = self.open_array()
        return self.array

    def prompt(self, instruction: str, **_: object) -> str:
        self.prompts.append(instruction)
        self.react(instruction)
        self.clock.sleep_s(3.0)
        return ""


@pytest.fixture
def bench(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    bench = Bench(tmp_path)
    opened = SimpleNamespace(array=bench.reopen_array, gripper=lambda: TwinGripper(bench.world))
    monkeypatch.setitem(sys.modules, "desk_of_the_test", opened)
    for module in ("rig.bench", "cli.calibrate_force"):
        monkeypatch.setattr(f"palpate.{module}.RealClock", lambda: bench.clock)
    monkeypatch.setattr("typer.prompt", bench.prompt)
    yield bench
    bench.array.close()
    for stream in bench.clock.streams:
        stream.close()
    bench.board.unplug()


@pytest.mark.parametrize(
    ("known", "cell", "by_weight", "scales"),
    [([], 0, -2_000_000, [-5e-6]), ([4e-6], 1, 1_000_000, [4e-6, 1e-5])],
)
def test_calibrate_cell_known_weight_prints_the_rig_file_table(
    known: list[float],
    cell: int,
    by_weight: int,
    scales: list[float],
    bench: Bench,
    palpate: Command,
) -> None:
    def place_weight(instruction: str) -> None:
        bench.board.raw[cell] = 1_000 + by_weight * ("remove everything" not in instruction)

    bench.react = place_weight
    options = ("--rig", bench.rig, "--cell", cell, "--known-n", "10")
    if known:
        bench.rig.write_text(TABLES)
        assert "calibrate cell 0 first" in palpate("calibrate", "cell", *options, status=2).err
    bench.rig.write_text(TABLES + f"[load_cells]\nnewtons_per_count = {known}\n" * bool(known))
    assert has_load_cell(str(bench.rig)) == bool(known)
    line = palpate("calibrate", "cell", *options).out
    assert line == f"[load_cells]\nnewtons_per_count = {scales}\n"
    bench.rig.write_text(TABLES + line)
    assert has_load_cell(str(bench.rig))


@pytest.mark.slow
def test_calibrate_compliance_works_with_two_load_cells(
    bench: Bench, tmp_path: Path, palpate: Command
) -> None:
    bench.rig.write_text(TABLES + "[load_cells]\nnewtons_per_count = [5e-6, -4e-6]\n")
    out = tmp_path / "pad.json"
    rest = RestValues(ohm=((9e3, 8e3),) * 4, spread_percent=((0.1, 0.2),) * 4, frames=30)
    replace_rest(None, rest, layout=RIGID_LAYOUT, simulated=False).save(out)
    cell = TwinLoadCell(bench.world)
    zeros = [30_000, -70_000]

    def read_cells() -> list[int]:
        force_n = cell.read_n()
        return [zeros[0] + round(force_n / 5e-6), zeros[1] - round(force_n / 4e-6)]

    def place_block(instruction: str) -> None:
        is_placed = "between the open fingers" in instruction
        block = draw_object(np.random.default_rng(1), "rigid-block")
        bench.world.place(block if is_placed else None)
        zeros[0] += 3_000_000 if is_placed else -3_000_000  # the block weighs on its cell

    bench.board.weighed, bench.react = read_cells, place_block
    # Without --out, the command updates the calibration file named in the rig file.
    arguments = ("--rig", str(bench.rig), "--block-mm", "40")
    document = palpate("calibrate", "compliance", *arguments, "--json").document
    assert bench.prompts[0].startswith("place the rigid block with the load cell")
    assert bench.prompts[1].startswith("remove the block")
    assert document["simulated"] is False
    assert 0.1 < document["fingers_mm_per_n"] < 0.4
    made = Calibration.load(out)
    assert min(made.current.width_mm) < 10.0, "the empty gripper must close completely"
    assert max(made.block.force_n) == pytest.approx(15.0, abs=3.0)
