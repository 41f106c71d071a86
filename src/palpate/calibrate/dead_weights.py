"""Dead weights on a sheet: settled readings paired with typed loads, up and down."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.clock import Clock
from palpate.errors import CalibrationError, InputError
from palpate.holds.strict import read_table
from palpate.sensor.array import FRAME_TIMEOUT_S, PressureArray
from palpate.sensor.calibration import ForcePairs
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.relative import (
    excess_conductance,
    mean_change,
    relative_change_percent,
    rest_baseline,
    total_excess,
)

#: When the sheet counts as settled (paper, section 2.2), and how long a step is given at most.
SETTLED_S, _PATIENCE_S = 20.0, 40.0
#: Settled: two stretches of this length, one after the other, differ by less than this fraction.
_STRETCH_S, _SETTLED_SHARE = 2.0, 0.03
#: Excess conductance that counts as nothing: below it a fraction means nothing.
_FAINT_EXCESS = 0.1
#: A pixel that reads less than this is at the end of its converter.
_SATURATED_OHM = 1.0
_REST_S = 2.0
#: Fewest loads, and the ratio of the largest to the smallest: close together they show no slope.
FEWEST, _LEAST_RATIO = 3, 2.0
#: Heavier than anything this sensor is made for: grams taken for newtons.
_HEAVIEST_N = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Weighing:
    """The pairs of every step that settled, and the loads of those that did not."""

    pairs: ForcePairs
    refused_n: tuple[float, ...]


def read_loads(path: Path) -> list[float]:
    """Return the loads of a table's column `load_n`, in the order of the file.

    Raises `InputError` if the file can't be read, has no such column, or holds what can't be loads
    in newtons.
    """
    loads = read_table(path, columns={"load_n": "number"})["load_n"]
    return check_loads(loads.tolist(), where=str(path))


def check_loads(loads_n: Sequence[float], *, where: str) -> list[float]:
    """Return loads that can carry a calibration.

    Raises `InputError` if there are too few, one only, or they can't be newtons.
    """
    loads = [float(load) for load in loads_n]
    if not all(np.isfinite(load) and load >= 0 for load in loads):
        raise InputError(f"{where}: every load must be a finite number of newtons, 0 or more")
    laid = sorted({load for load in loads if load > 0})
    if len(laid) < FEWEST or laid[-1] < _LEAST_RATIO * laid[0]:
        raise InputError(
            f"{where}: {len(loads)} loads, {len(set(loads))} of them different; give at least "
            f"{FEWEST} spread over the range, the largest {_LEAST_RATIO:g} times the smallest, "
            "such as 1.5, 4 and 9 N"
        )
    if max(loads) > _HEAVIEST_N:
        raise InputError(
            f"{where}: a load of {max(loads):g} N is too much for this sensor; "
            "are the loads in grams? Newtons are grams x 0.00981"
        )
    return loads


def weigh(
    array: PressureArray,
    *,
    loads_n: Iterable[float],
    place: Callable[[float], None],
    clock: Clock,
    settled: Callable[[float, float], None] | None = None,
) -> Weighing:
    """Read the settled value under each load.

    `array`: without any load at first.
    `loads_n`: in the order in which they are put on; each is asked for when the last was read.
    `place`: called with each load; returns once it lies on the sheet.
    `clock`: the clock that frames are stamped by: those from before are dropped.
    `settled`: called with excess conductance and load of each that settled.
    Raises `CalibrationError` if a pixel is at the end of its converter under a load, or fewer than
    three steps settle.
    """
    rest_ohm = rest_baseline(_ohm(array, _REST_S)).rest_ohm
    settled_n, excess, relative = list[float](), list[float](), list[float]()
    refused: list[float] = []
    for load_n in loads_n:
        place(load_n)
        placed_s = clock.now_s()
        while array.read(timeout_s=FRAME_TIMEOUT_S).time_s < placed_s:
            pass
        reading = _settle(array, rest_ohm, load_n)
        if reading is None:
            refused.append(load_n)
        elif load_n > 0:
            settled_n.append(load_n)
            excess.append(reading[0])
            relative.append(reading[1])
            if settled is not None:
                settled(reading[0], load_n)
    if len(settled_n) < FEWEST:
        raise CalibrationError(
            f"force calibration: {len(settled_n)} loads settled, at least {FEWEST} needed; keep "
            "everything still and lay the weights down on a flat stamp"
        )
    pairs = ForcePairs(
        run=(0,) * len(settled_n),
        since_move_s=(SETTLED_S,) * len(settled_n),
        excess=tuple(excess),
        relative_percent=tuple(relative),
        force_n=tuple(settled_n),
    )
    return Weighing(pairs=pairs, refused_n=tuple(refused))


def has_hysteresis(force_n: Sequence[float]) -> bool:
    """Whether loads fell as well as rose."""
    return bool((np.diff(np.asarray(force_n, dtype=float)) < 0).any())


def _settle(
    array: PressureArray, rest_ohm: np.ndarray, load_n: float
) -> tuple[float, float] | None:
    """Return excess and relative change once two stretches agree; None if they never do."""
    waited_s = SETTLED_S - 2 * _STRETCH_S
    _ohm(array, waited_s)
    before, _ = _measure_load(array, rest_ohm, load_n)
    while waited_s < _PATIENCE_S:
        after, relative = _measure_load(array, rest_ohm, load_n)
        if abs(after - before) <= max(_SETTLED_SHARE * abs(after), _FAINT_EXCESS):
            return after, relative
        before = after
        waited_s += _STRETCH_S
    return None


def _measure_load(array: PressureArray, rest_ohm: np.ndarray, load_n: float) -> tuple[float, float]:
    """Return excess conductance and relative change, both in the mean over a stretch."""
    ohm = _ohm(array, _STRETCH_S)
    if float(np.min(ohm.mean(axis=0))) < _SATURATED_OHM:
        raise CalibrationError(
            f"force calibration: a pixel is saturated at {load_n:g} N; use a smaller "
            "reference resistor, or smaller loads"
        )
    excess = total_excess(excess_conductance(ohm, rest_ohm=rest_ohm))
    relative = mean_change(relative_change_percent(ohm, rest_ohm=rest_ohm))
    return float(np.mean(excess)), float(np.mean(relative))


def _ohm(array: PressureArray, duration_s: float) -> np.ndarray:
    frames = [array.read(timeout_s=FRAME_TIMEOUT_S)]
    while frames[-1].time_s < frames[0].time_s + duration_s:
        frames.append(array.read(timeout_s=FRAME_TIMEOUT_S))
    return pixel_resistance_ohm(
        np.array([frame.counts for frame in frames]),
        layout=array.layout,
        oversampling=frames[0].oversampling,
    )
