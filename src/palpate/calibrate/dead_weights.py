"""Calibration with dead weights: settled readings paired with entered loads."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibration import ForcePairs
from palpate.clock import Clock
from palpate.errors import CalibrationError, InputError
from palpate.force.of_calibration import HORIZON_S, fit_sheet_law
from palpate.holds.strict import read_table
from palpate.holds.units import find_unit
from palpate.sensor.array import FRAME_TIMEOUT_S, ArrayLayout, PressureArray
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import SampleReader, pixel_resistance_ohm
from palpate.signal.relative import mean_change, total_excess

#: Maximum time per load.
_MAX_WAIT_S = 40.0
#: A reading is settled if two successive stretches of this length differ by less than a fraction.
_STRETCH_S, _SETTLED_FRACTION = 2.0, 0.03
#: Excess conductance below which a relative difference is meaningless.
_NEGLIGIBLE_EXCESS = 0.1
#: Excess of every pixel below which nothing is on the sheet: twice the trend of 1 % that a rest
#: measurement may have.
_AT_REST_EXCESS = 0.02
#: The mean reading of a load must exceed this many standard deviations of a frame at rest: the
#: noise of Velostat is slow, and averages out less than that of an amplifier.
_NOISE_SIGMAS = 3.0
#: Ratio of two loads whose readings must differ by more than the settled fraction.
_OTHER_LOAD_RATIO = 1.2
#: Ratio of two readings of one load that is reported.
_UNEQUAL_RATIO = 1.5
#: Largest fraction of frames with a pixel that is saturated or has no reading.
_UNUSABLE_FRACTION = 0.1
_REST_S = 2.0
#: Minimum number of loads, and minimum ratio of the largest to the smallest load.
MIN_LOADS, _MIN_LOAD_RATIO = 3, 2.0
#: First forces of a calibration with weights, newtons, at which it also reports its intervals. They
#: are spread over the range of a gripper. With these three weights, the error of real staircases
#: was 0.20 in ln force; with first weights of 0.6 to 1.2 N it was 1.0.
SPREAD_N = (1.5, 4.0, 9.0)
#: Factors of the readings among which that of a force is searched.
_FACTORS = np.geomspace(1e-2, 1e2, 400)
#: A number, and a unit if any.
_TYPED_LOAD = re.compile(r"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(.*)")
#: Weight of 5 kg. Velostat saturates below it; larger values are probably grams.
_MAX_LOAD_N = 49.1


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadMeasurement:
    """Pairs of the usable loads above 0 N, and the loads without a usable reading."""

    pairs: ForcePairs
    refused_n: tuple[float, ...]


class _UnusableReadingError(Exception):
    """The reading of one load can't be used; the text is the reason."""


def read_loads(path: Path) -> list[float]:
    """Return the column `load_n` of a table, in the order of the file.

    Raises `InputError` if the file can't be read, has no such column, or contains invalid loads.
    """
    loads = read_table(path, columns={"load_n": "number"})["load_n"]
    return check_loads(loads.tolist(), where=str(path))


def parse_load(typed: str) -> float:
    """Return a typed load, newtons; without a unit it is in newtons.

    Raises `InputError` if it can't be a load.

    >>> parse_load("1.5"), round(parse_load("100 g"), 3)
    (1.5, 0.981)
    """
    number, unit = _TYPED_LOAD.fullmatch(typed.strip()), None
    if number is not None:
        unit = find_unit(number[2] or "N")
    if number is None or unit is None or unit.quantity != "newton":
        raise InputError(
            f"load {typed!r}: type a number of newtons, or one with its unit (g, kg, N, mN, lbf), "
            "such as 4.0 or 250 g"
        )
    load_n = float(number[1]) * unit.factor
    _check_newtons([load_n], where=f"load {typed!r}")
    return load_n


def check_loads(loads_n: Iterable[float], *, where: str) -> list[float]:
    """Return the loads if they suffice for a calibration.

    Raises `InputError` if there are too few different loads, or they can't be newtons.
    """
    loads = [float(load) for load in loads_n]
    _check_newtons(loads, where=where)
    laid = sorted({load for load in loads if load > 0})
    if len(laid) < MIN_LOADS:
        raise InputError(
            f"{where}: {_describe_too_few(laid)}, spread over the range, such as 150, 400 and 900 g"
        )
    if laid[-1] < _MIN_LOAD_RATIO * laid[0]:
        raise InputError(
            f"{where}: the largest weight, {laid[-1]:.4g} N, must be at least {_MIN_LOAD_RATIO:g} "
            f"times the smallest, {laid[0]:.4g} N; spread them over the "
            "range, such as 150, 400 and 900 g"
        )
    return loads


def _describe_too_few(laid: Sequence[float]) -> str:
    """Return how many different loads there are, and how many are needed.

    >>> _describe_too_few([1.5])
    'at least 3 different weights are needed, not 1 (1.5 N)'
    """
    named = f" ({', '.join(f'{load:.4g}' for load in laid)} N)" if laid else ""
    return f"at least {MIN_LOADS} different weights are needed, not {len(laid)}{named}"


def _check_newtons(loads: Sequence[float], *, where: str) -> None:
    if not all(np.isfinite(load) and load >= 0 for load in loads):
        raise InputError(f"{where}: every load must be a finite number of newtons, 0 or more")
    if max(loads, default=0.0) > _MAX_LOAD_N:
        raise InputError(
            f"{where}: a load of {max(loads):.4g} N is too large for this sensor; "
            "if the loads are in grams, multiply them by 0.00981 for newtons"
        )


def measure_loads(
    array: PressureArray,
    *,
    loads_n: Iterable[float],
    place: Callable[[float], None],
    clock: Clock,
    settled: Callable[[ForcePairs], None] | None = None,
    tell: Callable[[str], None] | None = None,
) -> LoadMeasurement:
    """Read the settled value under each load.

    `array`: the unloaded sensor.
    `loads_n`: loads in order of application; each is requested after the previous reading.
    `place`: called with each load; returns once the load is on the sheet.
    `clock`: clock of the frames' timestamps; frames from before the placement are dropped.
    `settled`: called after each usable reading with all pairs so far.
    `tell`: called with a sentence for each load that is left out, and for unequal readings of one
        load. A load is left out if its reading does not settle, is that at rest, or is that of
        another load just before.
    Raises `CalibrationError` if a pixel saturates under a load, or fewer than three different loads
    have a usable reading.
    """
    tell = tell or (lambda _: None)
    rest = rest_baseline(_ohm(array, _REST_S))
    rest_ohm = rest.rest_ohm
    # Excess of each pixel that may be the reading at rest.
    noise = np.maximum(_AT_REST_EXCESS, 0.01 * _NOISE_SIGMAS * rest.spread_percent)
    settled_n, excess, relative = list[float](), list[float](), list[float]()
    by_pixel = list[tuple[float, ...]]()
    refused: list[float] = []
    previous: tuple[float, float] | None = None
    for load_n in loads_n:
        place(load_n)
        placed_s = clock.now_s()
        while array.read(timeout_s=FRAME_TIMEOUT_S).time_s < placed_s:
            pass
        try:
            reading = _measure_settled(array, rest_ohm, load_n)
            if load_n > 0:
                _check_reading(reading, load_n, noise=noise, previous=previous)
        except _UnusableReadingError as error:
            refused.append(load_n)
            tell(f"excluded: {load_n:.4g} N {error}")
            continue
        previous = load_n, reading.excess
        if load_n <= 0:
            continue
        for other_n, other in zip(settled_n, excess, strict=True):
            if other_n == load_n and abs(np.log(reading.excess / other)) > np.log(_UNEQUAL_RATIO):
                tell(
                    f"{load_n:.4g} N read {other:.3g} before and {reading.excess:.3g} now (excess "
                    "conductance); the interval of the force includes both"
                )
                break
        settled_n.append(load_n)
        excess.append(reading.excess)
        relative.append(reading.relative_percent)
        # A pixel without a reading adds nothing to the sum either.
        by_pixel.append(tuple(np.nan_to_num(reading.by_pixel).ravel().tolist()))
        if settled is not None:
            settled(_pair(settled_n, excess, relative, by_pixel))
    if len(set(settled_n)) < MIN_LOADS:
        raise CalibrationError(
            f"force calibration: {_describe_too_few(sorted(set(settled_n)))}, with a settled "
            "reading; avoid vibration and place the weights on a flat stamp"
        )
    pairs = _pair(settled_n, excess, relative, by_pixel)
    return LoadMeasurement(pairs=pairs, refused_n=tuple(refused))


def _pair(
    force_n: Sequence[float],
    excess: Sequence[float],
    relative_percent: Sequence[float],
    pixel_excess: Sequence[tuple[float, ...]],
) -> ForcePairs:
    """Return settled readings of weights as pairs; each weight is a placement of its own."""
    return ForcePairs(
        run=tuple(range(len(force_n))),
        since_move_s=(HORIZON_S,) * len(force_n),
        excess=tuple(excess),
        relative_percent=tuple(relative_percent),
        force_n=tuple(force_n),
        pixel_excess=tuple(pixel_excess),
    )


def half_widths_percent(pairs: ForcePairs, *, layout: ArrayLayout) -> dict[str, float]:
    """Return the half-width of a settled force's 90 % interval at 1.5, 4 and 9 N, percent of it.

    `pairs`: of weights, as `measure_loads` returns; the load is distributed as under these.
    Raises `CalibrationError` as `fit_sheet_law`.
    """
    law, excess = fit_sheet_law(pairs, layout=layout), np.array(pairs.pixel_excess)
    usual = np.mean(excess / excess.sum(axis=1, keepdims=True), axis=0)
    found = law.read_settled(excess.sum(axis=1).mean() * _FACTORS[:, None] * usual)
    low, high = law.interval_n(found.force_n, log_sd=found.log_sd)
    nearest = [int(np.argmin(np.abs(np.log(found.force_n / at_n)))) for at_n in SPREAD_N]
    return {
        f"{at_n:g}": float(50.0 * (high[one] - low[one]) / found.force_n[one])
        for at_n, one in zip(SPREAD_N, nearest, strict=True)
    }


def has_unloading(force_n: Sequence[float]) -> bool:
    """Return whether any load is lower than the previous one."""
    return bool((np.diff(np.asarray(force_n, dtype=float)) < 0).any())


@dataclass(frozen=True, slots=True, kw_only=True)
class _LoadReading:
    """Excess conductance of all pixels and of each one, and mean relative change."""

    excess: float
    #: Shape (rows, cols).
    by_pixel: FloatArray
    relative_percent: float


def _measure_settled(array: PressureArray, rest_ohm: FloatArray, load_n: float) -> _LoadReading:
    """Return the settled reading; raise `_UnusableReadingError` after the maximum time."""
    waited_s = HORIZON_S - 2 * _STRETCH_S
    _ohm(array, waited_s)
    before = _measure_load(array, rest_ohm, load_n)
    while waited_s < _MAX_WAIT_S:
        after = _measure_load(array, rest_ohm, load_n)
        change = abs(after.excess - before.excess)
        if change <= max(_SETTLED_FRACTION * abs(after.excess), _NEGLIGIBLE_EXCESS):
            return after
        before = after
        waited_s += _STRETCH_S
    raise _UnusableReadingError("did not settle")


def _check_reading(
    reading: _LoadReading,
    load_n: float,
    *,
    noise: FloatArray,
    previous: tuple[float, float] | None,
) -> None:
    """Raise `_UnusableReadingError` for the reading at rest, or that of another load before.

    `noise`, shape (rows, cols): excess of each pixel that may be the reading at rest.
    """
    if (reading.by_pixel < -noise).any() and not (reading.by_pixel > noise).any():
        raise _UnusableReadingError(
            "raises the resistance; if the board reads the voltage over the other part of the "
            "divider, correct taxel_leg in the rig file"
        )
    if reading.excess <= 0 or not (reading.by_pixel > noise).any():
        raise _UnusableReadingError(
            "has the reading at rest; place the weight on the pixels, then repeat it"
        )
    if previous is None or previous[0] <= 0:
        return
    other_load = abs(np.log(load_n / previous[0])) > np.log(_OTHER_LOAD_RATIO)
    if other_load and abs(np.log(reading.excess / previous[1])) < _SETTLED_FRACTION:
        raise _UnusableReadingError(
            f"has the reading of {previous[0]:.4g} N just before; check that the weight was "
            "changed and that the sensor is within its range"
        )


def _measure_load(array: PressureArray, rest_ohm: FloatArray, load_n: float) -> _LoadReading:
    """Return the reading averaged over a stretch, without its few unusable frames."""
    pixels = SampleReader(array.layout, rest_ohm).read_ohm(_ohm(array, _STRETCH_S))
    for unusable, text in (
        (pixels.saturated, "is saturated"),
        (pixels.open, "has no reading"),
    ):
        if float(np.mean(unusable.any(axis=(1, 2)))) > _UNUSABLE_FRACTION:
            remedy = "use a smaller reference resistor, or smaller loads"
            raise CalibrationError(
                f"force calibration: a pixel {text} at {load_n:.4g} N; "
                + (remedy if unusable is pixels.saturated else "run `palpate doctor`")
            )
    usable = ~(pixels.saturated | pixels.open).any(axis=(1, 2))
    change, excess = pixels.change_percent[usable], pixels.excess[usable]
    return _LoadReading(
        excess=float(np.mean(total_excess(excess))),
        by_pixel=excess.mean(axis=0),
        relative_percent=float(np.mean(mean_change(change))),
    )


def _ohm(array: PressureArray, duration_s: float) -> FloatArray:
    frames = [array.read(timeout_s=FRAME_TIMEOUT_S)]
    while frames[-1].time_s < frames[0].time_s + duration_s:
        frames.append(array.read(timeout_s=FRAME_TIMEOUT_S))
    return pixel_resistance_ohm(
        np.array([frame.counts for frame in frames]),
        layout=array.layout,
        oversampling=frames[0].oversampling,
    )
