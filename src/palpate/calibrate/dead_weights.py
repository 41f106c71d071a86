"""Calibration with dead weights: settled readings paired with entered loads."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.calibrate.laws import HORIZON_S
from palpate.clock import Clock
from palpate.errors import CalibrationError, InputError
from palpate.holds.strict import read_table
from palpate.sensor.array import FRAME_TIMEOUT_S, PressureArray
from palpate.sensor.calibration import ForcePairs
from palpate.sensor.pixel_resistance import pixel_excess, pixel_resistance_ohm
from palpate.signal.relative import (
    mean_change,
    relative_change_percent,
    rest_baseline,
    total_excess,
)

#: Maximum time per load.
_MAX_WAIT_S = 40.0
#: A reading is settled if two successive stretches of this length differ by less than a fraction.
_STRETCH_S, _SETTLED_FRACTION = 2.0, 0.03
#: Excess conductance below which a relative difference is meaningless.
_NEGLIGIBLE_EXCESS = 0.1
#: A pixel with a lower resistance is saturated.
_SATURATED_OHM = 1.0
_REST_S = 2.0
#: Minimum number of loads, and minimum ratio of the largest to the smallest load.
MIN_LOADS, _MIN_LOAD_RATIO = 3, 2.0
#: Above the range of this sensor; larger values are probably grams.
_MAX_LOAD_N = 200.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadMeasurement:
    """Pairs of the settled loads above 0 N, and the unsettled loads."""

    pairs: ForcePairs
    refused_n: tuple[float, ...]


def read_loads(path: Path) -> list[float]:
    """Return the column `load_n` of a table, in the order of the file.

    Raises `InputError` if the file can't be read, has no such column, or contains invalid loads.
    """
    loads = read_table(path, columns={"load_n": "number"})["load_n"]
    return check_loads(loads.tolist(), where=str(path))


def parse_load(typed: str) -> float:
    """Return a typed load, newtons.

    Raises `InputError` if it can't be newtons.

    >>> parse_load("1.5")
    1.5
    """
    try:
        load_n = float(typed)
    except ValueError as error:
        raise InputError(f"load {typed!r}: type newtons, such as 4.0") from error
    _check_newtons([load_n], where=f"load {typed!r}")
    return load_n


def check_loads(loads_n: Sequence[float], *, where: str) -> list[float]:
    """Return the loads if they suffice for a calibration.

    Raises `InputError` if there are too few different loads, or they can't be newtons.
    """
    loads = [float(load) for load in loads_n]
    _check_newtons(loads, where=where)
    laid = sorted({load for load in loads if load > 0})
    if len(laid) < MIN_LOADS or laid[-1] < _MIN_LOAD_RATIO * laid[0]:
        raise InputError(
            f"{where}: {len(loads)} loads, {len(set(loads))} of them different; give at least "
            f"{MIN_LOADS} spread over the range, the largest {_MIN_LOAD_RATIO:g} times the "
            "smallest, such as 1.5, 4 and 9 N"
        )
    return loads


def _check_newtons(loads: Sequence[float], *, where: str) -> None:
    if not all(np.isfinite(load) and load >= 0 for load in loads):
        raise InputError(f"{where}: every load must be a finite number of newtons, 0 or more")
    if max(loads, default=0.0) > _MAX_LOAD_N:
        raise InputError(
            f"{where}: a load of {max(loads):g} N is too large for this sensor; "
            "if the loads are in grams, multiply them by 0.00981 for newtons"
        )


def measure_loads(
    array: PressureArray,
    *,
    loads_n: Iterable[float],
    place: Callable[[float], None],
    clock: Clock,
    settled: Callable[[float, float], None] | None = None,
) -> LoadMeasurement:
    """Read the settled value under each load.

    `array`: the unloaded sensor.
    `loads_n`: loads in order of application; each is requested after the previous reading.
    `place`: called with each load; returns once the load is on the sheet.
    `clock`: clock of the frames' timestamps; frames from before the placement are dropped.
    `settled`: called with the excess conductance and load of each settled reading.
    Raises `CalibrationError` if a pixel saturates under a load, or fewer than three readings
    settle.
    """
    rest_ohm = rest_baseline(_ohm(array, _REST_S)).rest_ohm
    settled_n, excess, relative = list[float](), list[float](), list[float]()
    refused: list[float] = []
    for load_n in loads_n:
        place(load_n)
        placed_s = clock.now_s()
        while array.read(timeout_s=FRAME_TIMEOUT_S).time_s < placed_s:
            pass
        reading = _measure_settled(array, rest_ohm, load_n)
        if reading is None:
            refused.append(load_n)
        elif load_n > 0:
            settled_n.append(load_n)
            excess.append(reading[0])
            relative.append(reading[1])
            if settled is not None:
                settled(reading[0], load_n)
    if len(settled_n) < MIN_LOADS:
        raise CalibrationError(
            f"force calibration: {len(settled_n)} loads settled, at least {MIN_LOADS} needed; "
            "avoid vibration and place the weights on a flat stamp"
        )
    pairs = ForcePairs(
        run=(0,) * len(settled_n),
        since_move_s=(HORIZON_S,) * len(settled_n),
        excess=tuple(excess),
        relative_percent=tuple(relative),
        force_n=tuple(settled_n),
    )
    return LoadMeasurement(pairs=pairs, refused_n=tuple(refused))


def has_unloading(force_n: Sequence[float]) -> bool:
    """Return whether any load is lower than the previous one."""
    return bool((np.diff(np.asarray(force_n, dtype=float)) < 0).any())


def _measure_settled(
    array: PressureArray, rest_ohm: np.ndarray, load_n: float
) -> tuple[float, float] | None:
    """Return the settled excess and relative change, or None after the maximum time."""
    waited_s = HORIZON_S - 2 * _STRETCH_S
    _ohm(array, waited_s)
    before, _ = _measure_load(array, rest_ohm, load_n)
    while waited_s < _MAX_WAIT_S:
        after, relative = _measure_load(array, rest_ohm, load_n)
        if abs(after - before) <= max(_SETTLED_FRACTION * abs(after), _NEGLIGIBLE_EXCESS):
            return after, relative
        before = after
        waited_s += _STRETCH_S
    return None


def _measure_load(array: PressureArray, rest_ohm: np.ndarray, load_n: float) -> tuple[float, float]:
    """Return excess conductance and relative change, averaged over a stretch."""
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
