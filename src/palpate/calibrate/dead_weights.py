"""Calibration with dead weights: settled readings paired with entered loads."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.calibrate.early_reading import find_early
from palpate.calibration import ForcePairs
from palpate.clock import Clock
from palpate.errors import CalibrationError, InputError
from palpate.force.creep_update import EARLY_S
from palpate.force.of_calibration import (
    HORIZON_S,
    find_loaded_pads,
    fit_sheet_law,
    settled_pairs,
)
from palpate.holds.strict import read_table
from palpate.holds.units import find_unit
from palpate.sensor.array import FRAME_TIMEOUT_S, ArrayLayout, Frame, PressureArray
from palpate.sensor.rest_baseline import rest_baseline
from palpate.sensor.sample import PixelSignals, SampleReader, pixel_resistance_ohm
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
    """Pairs of the usable loads above 0 N, and the loads without a usable reading.

    A load whose placement was recorded has an early reading before the settled one.
    """

    pairs: ForcePairs
    refused_n: tuple[float, ...]


class KeptFrames:
    """An array whose frames are kept, for the early reading of a weight.

    Pass one to `measure_loads` if its `place` reads frames.
    """

    def __init__(self, array: PressureArray) -> None:
        self._array = array
        #: The frames of the present placement.
        self.frames: list[Frame] = []

    @property
    def layout(self) -> ArrayLayout:
        """Layout of the array."""
        return self._array.layout

    def read(self, *, timeout_s: float) -> Frame:
        """Return the next frame."""
        self.frames.append(self._array.read(timeout_s=timeout_s))
        return self.frames[-1]

    def close(self) -> None:
        """Close the array."""
        self._array.close()


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
    """Read the settled value under each load, and the early one if its placement was recorded.

    `array`: the unloaded sensor.
    `loads_n`: loads in order of application; each is requested after the previous reading.
    `place`: called with each load; returns once the load is on the sheet. The frames that arrived
        until then show when it was placed.
    `clock`: clock of the frames' timestamps; the load settles from the return of `place` on.
    `settled`: called after each usable reading with all pairs so far.
    `tell`: called with a sentence for each load that is left out, and for unequal readings of one
        load. A load is left out if its reading does not settle, is that at rest, or is that of
        another load just before.
    Raises `CalibrationError` if a pixel saturates under a load, or fewer than three different loads
    have a usable reading.
    """
    tell = tell or (lambda _: None)
    kept = array if isinstance(array, KeptFrames) else KeptFrames(array)
    rest = rest_baseline(_ohm(kept, _REST_S))
    rest_ohm = rest.rest_ohm
    # Excess of each pixel that may be the reading at rest.
    noise = np.maximum(_AT_REST_EXCESS, 0.01 * _NOISE_SIGMAS * rest.spread_percent)
    weighed, refused = list[_Weighed](), list[float]()
    previous: tuple[float, float] | None = None
    for load_n in loads_n:
        kept.frames.clear()
        place(load_n)
        placed_s = clock.now_s()
        while kept.read(timeout_s=FRAME_TIMEOUT_S).time_s < placed_s:
            pass
        try:
            reading = _measure_settled(kept, rest_ohm, load_n)
            if load_n > 0:
                _check_reading(reading, load_n, noise=noise, previous=previous)
        except _UnusableReadingError as error:
            refused.append(load_n)
            tell(f"excluded: {load_n:.4g} N {error}")
            continue
        previous = load_n, reading.excess
        if load_n <= 0:
            continue
        for other in weighed:
            both = np.stack([reading.by_pixel.ravel(), other.settled.by_pixel.ravel()])
            on_now, on_before = find_loaded_pads(both, layout=kept.layout).T
            is_repeated = other.load_n == load_n and (on_now == on_before).all()
            ratio = reading.excess / other.settled.excess
            if is_repeated and abs(np.log(ratio)) > np.log(_UNEQUAL_RATIO):
                tell(
                    f"{load_n:.4g} N read {other.settled.excess:.3g} before and "
                    f"{reading.excess:.3g} now (excess conductance); the interval of the force "
                    "includes both"
                )
                break
        early = _find_early(kept, rest_ohm, settled=reading)
        weighed.append(_Weighed(load_n=load_n, early=early, settled=reading))
        if settled is not None:
            settled(_pair(weighed))
    loads = {one.load_n for one in weighed}
    if len(loads) < MIN_LOADS:
        raise CalibrationError(
            f"force calibration: {_describe_too_few(sorted(loads))}, with a settled "
            "reading; avoid vibration and place the weights on a flat stamp"
        )
    return LoadMeasurement(pairs=_pair(weighed), refused_n=tuple(refused))


def _pair(weighed: Sequence[_Weighed]) -> ForcePairs:
    """Return the readings of weights as pairs; each weight is a placement of its own."""
    rows = [
        (run, since_s, reading, one.load_n)
        for run, one in enumerate(weighed)
        for since_s, reading in ((EARLY_S, one.early), (HORIZON_S, one.settled))
        if reading is not None
    ]
    return ForcePairs(
        run=tuple(run for run, _, _, _ in rows),
        since_move_s=tuple(since_s for _, since_s, _, _ in rows),
        excess=tuple(reading.excess for _, _, reading, _ in rows),
        relative_percent=tuple(reading.relative_percent for _, _, reading, _ in rows),
        force_n=tuple(load_n for _, _, _, load_n in rows),
        # A pixel without a reading adds nothing to the sum either.
        pixel_excess=tuple(
            tuple(np.nan_to_num(reading.by_pixel).ravel().tolist()) for _, _, reading, _ in rows
        ),
    )


def half_widths_percent(pairs: ForcePairs, *, layout: ArrayLayout) -> dict[str, float]:
    """Return the half-width of a settled force's 90 % interval at 1.5, 4 and 9 N, percent of it.

    `pairs`: of weights, as `measure_loads` returns; the load is distributed as under these.
    Raises `CalibrationError` as `fit_sheet_law`.
    """
    law = fit_sheet_law(pairs, layout=layout)
    excess = np.array(settled_pairs(pairs).pixel_excess)
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


@dataclass(frozen=True, slots=True, kw_only=True)
class _Weighed:
    """The readings of one weight; the early one is None if the placement was not recorded."""

    load_n: float
    early: _LoadReading | None
    settled: _LoadReading


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
    return _average(pixels, _is_usable(pixels))


def _find_early(
    kept: KeptFrames, rest_ohm: FloatArray, *, settled: _LoadReading
) -> _LoadReading | None:
    """Return the reading shortly after a weight was placed; None if the frames do not show it."""
    ohm = _convert(kept.frames, layout=kept.layout)
    pixels = SampleReader(kept.layout, rest_ohm).read_ohm(ohm)
    chosen = find_early(
        np.array([frame.time_s for frame in kept.frames]),
        np.where(_is_usable(pixels), total_excess(pixels.excess), np.nan),
        settled=settled.excess,
    )
    return _average(pixels, chosen) if chosen.any() else None


def _is_usable(pixels: PixelSignals) -> NDArray[np.bool_]:
    """Return which frames have a reading of every pixel, shape (frames,)."""
    return np.asarray(~(pixels.saturated | pixels.open).any(axis=(1, 2)))


def _average(pixels: PixelSignals, chosen: NDArray[np.bool_]) -> _LoadReading:
    """Return the mean of the chosen frames."""
    change, excess = pixels.change_percent[chosen], pixels.excess[chosen]
    return _LoadReading(
        excess=float(np.mean(total_excess(excess))),
        by_pixel=excess.mean(axis=0),
        relative_percent=float(np.mean(mean_change(change))),
    )


def _ohm(array: PressureArray, duration_s: float) -> FloatArray:
    frames = [array.read(timeout_s=FRAME_TIMEOUT_S)]
    while frames[-1].time_s < frames[0].time_s + duration_s:
        frames.append(array.read(timeout_s=FRAME_TIMEOUT_S))
    return _convert(frames, layout=array.layout)


def _convert(frames: Sequence[Frame], *, layout: ArrayLayout) -> FloatArray:
    """Return the resistances of frames."""
    return pixel_resistance_ohm(
        np.array([frame.counts for frame in frames]),
        layout=layout,
        oversampling=frames[0].oversampling,
    )
