"""`palpate calibrate cell`: what a count of a load cell weighs, by a known weight."""

from __future__ import annotations

import math
from contextlib import closing
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.calibrate_bench import ask_user
from palpate.cli.options import JsonOption
from palpate.cli.output import print_json
from palpate.cli.sensor_source import open_source
from palpate.clock import RealClock
from palpate.errors import CalibrationError, InputError
from palpate.rig.board_cell import board_with_cells, mean_counts
from palpate.rig.file import load_cells_stated

#: A thousandth of what 1 N moves a cell of 1 kg and 1 mV/V by: 200 000 counts of an HX711 at 128.
_LEAST_COUNTS = 1000.0


def cell(
    rig: Annotated[str, typer.Option(help="A rig file with a board.", metavar="TOML")],
    known_n: Annotated[
        float,
        typer.Option("--known-n", help="The weight, newtons (kg * 9.81).", metavar="NEWTONS"),
    ],
    cell: Annotated[
        int, typer.Option(help="Which load cell of the board.", min=0, max=1, metavar="N")
    ] = 0,
    as_json: JsonOption = False,
) -> None:
    """Weigh a known weight on one load cell; prints the line for the rig file.

    Example: palpate calibrate cell --rig rig.toml --cell 0 --known-n 9.81
    """
    if not (math.isfinite(known_n) and known_n > 0):
        raise InputError(f"--known-n must be above 0 newtons, not {known_n:g}")
    known = _read_scales(rig, cell=cell)
    newtons_per_count = known_n / _measure_counts(rig, cell=cell, known_n=known_n)
    line = [*known[:cell], newtons_per_count, *known[cell + 1 :]]
    if as_json:
        print_json({"rig": rig, "cell": cell, "newtons_per_count": line})
        return
    print("[load_cells]")
    print(f"newtons_per_count = [{', '.join(f'{scale:.6g}' for scale in line)}]")


def _read_scales(rig: str, *, cell: int) -> tuple[float, ...]:
    """Return what the rig file states already."""
    if not rig.endswith(".toml"):
        raise InputError(f"rig {rig!r} is simulated; give a rig file whose [array] is a board")
    known = load_cells_stated(Path(rig)) or ()
    if cell > len(known):
        raise InputError(
            f"--cell {cell}: calibrate cell 0 first and put its [load_cells] into {rig}"
        )
    return known


def _measure_counts(rig: str, *, cell: int, known_n: float) -> float:
    """Return by how many counts the weight moves the cell."""
    clock = RealClock()
    with closing(open_source(rig=rig)) as source:
        board = board_with_cells(source.array)
        ask_user(f"take everything off load cell {cell}, then Enter")
        (empty,) = mean_counts(board, cells=(cell,), clock=clock)
        ask_user(f"lay {known_n:g} N on load cell {cell}, wait until it lies still, then Enter")
        (loaded,) = mean_counts(board, cells=(cell,), clock=clock)
    if abs(loaded - empty) < _LEAST_COUNTS:
        raise CalibrationError(
            f"load cell {cell} moved by {loaded - empty:.0f} counts only; does the weight lie on "
            "it, and is it this cell? (--cell)"
        )
    return loaded - empty
