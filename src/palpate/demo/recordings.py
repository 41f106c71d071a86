"""Recordings as a data logger writes them: three simulated pads touched several times."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.files import atomic_path
from palpate.gripper.interface import GripperCommand
from palpate.signal.circuit import resistance_ohm
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World

_SIMULATED = "simulated with palpate's physical twin; no sensor was read"
_SEED = 1
#: How far the fingers close beyond the touch, mm, touch by touch.
_CLOSURES_MM = (2.0, 3.0, 2.5, 3.5)
_GAP_MM, _SPEED_MM_PER_S, _REST_S, _HOLD_S, _PAUSE_S = 6.0, 40.0, 2.0, 22.0, 8.0


def write_recordings(folder: Path) -> list[Path]:
    """Write three recordings of a pad that is touched four times, 22 s each.

    `folder`: made where it does not exist.
    Writes `ohm.csv`: seconds and ohms. `counts.csv`: milliseconds and the counts of a 10-bit
    converter whose divider has a resistor of 4700 ohm. `two-pads.csv`: two pixels, Unix time.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for number, (name, head, rows) in enumerate(
        (
            ("ohm.csv", ("time_s", "resistance_ohm"), _ohm_rows),
            ("counts.csv", ("ms", "A0"), _count_rows),
            ("two-pads.csv", ("timestamp", "left_ohm", "right_ohm"), _pair_rows),
        )
    ):
        obj = draw_object(np.random.default_rng([_SEED, number]), "ecoflex-10")
        world = World(obj, seed=_SEED + number, level="lab")
        time_s, counts = _record(world, touch_mm=obj.size_mm)
        path = folder / name
        with atomic_path(path) as temporary:
            _write(temporary, head, rows(time_s, counts, world))
        written.append(path)
    return written


def _record(world: World, *, touch_mm: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times and counts of the whole session, shapes (frames,) and (frames, pixels)."""
    array, gripper = TwinArray(world), TwinGripper(world)
    time_s, counts = [], []

    def read_for(duration_s: float) -> None:
        until_s = world.clock.now_s() + duration_s
        while world.clock.now_s() < until_s - 1e-9:
            frame = array.read(timeout_s=1.0)
            time_s.append(frame.time_s)
            counts.append(frame.counts.ravel().astype(float) / frame.oversampling)

    gripper.command(GripperCommand(target=touch_mm + _GAP_MM, rate=_SPEED_MM_PER_S))
    world.clock.sleep_s(_REST_S)
    read_for(_REST_S)
    for closure_mm in _CLOSURES_MM:
        gripper.command(GripperCommand(target=touch_mm - closure_mm, rate=_SPEED_MM_PER_S))
        read_for(_HOLD_S)
        gripper.command(GripperCommand(target=touch_mm + _GAP_MM, rate=_SPEED_MM_PER_S))
        read_for(_PAUSE_S)
    array.close()
    return np.array(time_s) - time_s[0], np.stack(counts)


def _ohm_of(counts: NDArray[np.float64], world: World) -> NDArray[np.float64]:
    return np.asarray(resistance_ohm(counts, divider=world.layout.divider))


def _ohm_rows(
    time_s: NDArray[np.float64], counts: NDArray[np.float64], world: World
) -> Iterable[Sequence[str]]:
    for t, ohm in zip(time_s, _ohm_of(counts, world)[:, 0], strict=True):
        yield f"{t:.3f}", f"{ohm:.1f}"


def _count_rows(
    time_s: NDArray[np.float64], counts: NDArray[np.float64], world: World
) -> Iterable[Sequence[str]]:
    for t, count in zip(time_s, counts[:, 0], strict=True):
        yield f"{1000 * t:.0f}", f"{count:.0f}"


def _pair_rows(
    time_s: NDArray[np.float64], counts: NDArray[np.float64], world: World
) -> Iterable[Sequence[str]]:
    ohm = _ohm_of(counts, world)
    for t, left, right in zip(1.7e9 + time_s, ohm[:, 0], ohm[:, -1], strict=True):
        yield f"{t:.3f}", f"{left:.1f}", f"{right:.1f}"


def _write(path: Path, head: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {_SIMULATED}\n")
        table = csv.writer(file)
        table.writerow(head)
        table.writerows(rows)
