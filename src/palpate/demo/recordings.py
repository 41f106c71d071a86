"""Example data-logger recordings of three simulated pads, each pressed several times."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.files import atomic_path
from palpate.gripper.interface import GripperCommand
from palpate.signal.circuit import resistance_ohm
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.world import World

_SIMULATED = "simulated with palpate's physical twin; no sensor was read"
_SEED = 1
#: Closing distance after contact for each press, mm.
_CLOSURES_MM = (2.0, 3.0, 2.5, 3.5)
_GAP_MM, _SPEED_MM_PER_S, _REST_S, _HOLD_S, _PAUSE_S = 6.0, 40.0, 2.0, 22.0, 8.0


def write_recordings(folder: Path) -> list[Path]:
    """Write recordings of three simulated pads, each with four presses of 22 s.

    `folder`: created if absent.
    Writes `ohm.csv`: seconds and ohms. `counts.csv`: milliseconds and counts of a 10-bit
    converter with a 4700 ohm divider. `two-pads.csv`: two pixels, Unix time.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (time_s, _, ohm), (logged_s, counts, _), (both_s, _, both_ohm) = map(_record, range(3))
    tables = {
        "ohm.csv": ("time_s,resistance_ohm", ["%.3f", "%.1f"], [time_s, ohm[:, 0]]),
        "counts.csv": ("ms,A0", ["%.0f", "%.0f"], [1000 * logged_s, counts[:, 0]]),
        "two-pads.csv": (
            "timestamp,left_ohm,right_ohm",
            ["%.3f", "%.1f", "%.1f"],
            [1.7e9 + both_s, both_ohm[:, 0], both_ohm[:, -1]],
        ),
    }
    for name, (head, form, columns) in tables.items():
        with atomic_path(folder / name) as temporary:
            np.savetxt(
                temporary,
                np.column_stack(columns),
                fmt=form,
                delimiter=",",
                header=f"# {_SIMULATED}\n{head}",
                comments="",
                newline="\r\n",
            )
    return [folder / name for name in tables]


def _record(number: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return times, shape (frames,), counts and ohms, shapes (frames, pixels), of one session."""
    obj = draw_object(np.random.default_rng([_SEED, number]), "ecoflex-10")
    world, touch_mm = World(obj, seed=_SEED + number, level="lab"), obj.size_mm
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
    read = np.stack(counts)
    ohm = np.asarray(resistance_ohm(read, divider=world.layout.divider))
    return np.array(time_s) - time_s[0], read, ohm
