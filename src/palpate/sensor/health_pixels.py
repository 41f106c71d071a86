"""Faults of single pixels, detected from frames at rest."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.sensor.findings import pixel_name
from palpate.sensor.sample import pixel_resistance_ohm, relative_change_percent
from palpate.signal.circuit import resistance_ohm, resolution_ohm

BoolArray: TypeAlias = NDArray[np.bool_]
PixelVerdict: TypeAlias = tuple[str, BoolArray, str, FloatArray]

#: Within this many counts of an end of the range a reading is only converter noise. A pixel with
#: this rest value is dead. A pixel with some such readings has a loose joint.
_END_COUNTS, _MIN_DROPOUTS = 1.0, 2
#: Frame-to-frame jumps that a sheet at rest cannot cause. A touch or a spike causes two jumps.
_JUMP_PERCENT, _MIN_JUMPS = 20.0, 3
#: Noise of one frame. The limit is a fifth of the paper's contact threshold, so that the threshold
#: is five standard deviations, or a multiple of the noise of the other pixels. A fluctuation below
#: one count is quantization, not noise.
_NOISY_PERCENT, _NOISY_RATIO, _QUIET_PERCENT, _COUNT = 2.0, 5.0, 0.5, 1.0
#: Change from the first to the last third of the frames, relative to the change common to all.
_DRIFT_PERCENT = 2.0
#: A pixel is stuck if a healthy pixel would be constant with a smaller probability than this.
_STUCK_PROBABILITY, _MIN_OTHERS = 1e-6, 3
#: Rest resistance relative to the median of all pixels, and to the calibration.
_REST_RATIO, _CHANGED_PERCENT = 10.0, 30.0
#: 90 % quantile of the absolute difference of two normal readings, in standard deviations.
_Q90_OF_DIFFERENCES = 1.6449 * math.sqrt(2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelReadings:
    """Statistics of each pixel; arrays have shape (rows, cols)."""

    #: Median resistance: inf for an open pixel, 0 for a short pixel.
    rest_ohm: FloatArray
    #: Standard deviation of one frame without slow changes; NaN for dead pixels.
    noise_percent: FloatArray
    #: Change from the first to the last third of the frames; NaN for dead pixels.
    drift_percent: FloatArray
    #: Relative change of the resistance for one count; NaN for dead pixels.
    count_percent: FloatArray


def measure_pixels(mean_counts: FloatArray, *, layout: ArrayLayout) -> PixelReadings:
    """Measure rest value, noise, drift and resolution of each pixel.

    `mean_counts`: shape (frames, rows, cols).
    """
    ohm = pixel_resistance_ohm(mean_counts, layout=layout)
    is_open, is_short = find_end_readings(np.median(mean_counts, axis=0), layout=layout)
    rest_ohm = np.where(is_open, np.inf, np.where(is_short, 0.0, np.median(ohm, axis=0)))
    is_working = np.isfinite(rest_ohm) & (rest_ohm > 0)
    safe_rest = np.where(is_working, rest_ohm, 1.0)
    change = relative_change_percent(ohm, rest_ohm=np.where(is_working, rest_ohm, np.nan))
    change = np.where(np.isnan(change), 0.0, change)
    steps = np.abs(np.diff(change, axis=0))
    third = max(len(ohm) // 3, 1)
    drift = np.mean(change[-third:], axis=0) - np.mean(change[:third], axis=0)
    count = 100.0 * resolution_ohm(safe_rest, divider=layout.divider) / safe_rest
    noise = np.quantile(steps, 0.9, axis=0) / _Q90_OF_DIFFERENCES
    return PixelReadings(
        rest_ohm=rest_ohm,
        noise_percent=np.where(is_working, noise, np.nan),
        drift_percent=np.where(is_working, drift, np.nan),
        count_percent=np.where(is_working, count, np.nan),
    )


def judge_pixels(
    mean_counts: FloatArray,
    *,
    steps_per_count: int,
    readings: PixelReadings,
    layout: ArrayLayout,
    known_ohm: FloatArray | None = None,
) -> Iterator[PixelVerdict]:
    """Yield the code, pixels, text and values of each fault, most severe first.

    `mean_counts`: shape (frames, rows, cols).
    `steps_per_count`: conversions summed per reading, which divide each count into as many steps.
    `known_ohm`, shape (rows, cols): rest values of the calibration.
    """
    nothing = np.zeros((layout.rows, layout.cols))
    yield "open", np.isinf(readings.rest_ohm), "reads open: no current flows", nothing
    yield "short", readings.rest_ohm == 0.0, "reads short: zero resistance", nothing
    is_working = np.isfinite(readings.noise_percent)
    ratio = np.where(is_working, readings.rest_ohm, 0.0) / _median_of_working_pixels(
        readings.rest_ohm
    )
    yield "faint", ratio > _REST_RATIO, "reads {} times the resistance of the other pixels", ratio
    noise = readings.noise_percent
    loud = (noise > _NOISY_PERCENT) | (
        (noise > _NOISY_RATIO * _median_of_working_pixels(noise)) & (noise > _QUIET_PERCENT)
    )
    drops, jumps = _count_drops_and_jumps(mean_counts, layout=layout)
    loose = (drops >= _MIN_DROPOUTS) | ((jumps >= _MIN_JUMPS) & ~loud)
    yield "loose", loose, "drops out or jumps {} times", drops + jumps
    loud &= noise >= _COUNT * readings.count_percent
    yield "noisy", loud, "noise of one frame is {} %", noise
    stuck = _find_stuck_pixels(
        mean_counts, steps_per_count, healthy=is_working & ~loose, layout=layout
    )
    yield "stuck", stuck, "is constant, despite the noise of the other pixels", nothing
    common = _median_of_working_pixels(readings.drift_percent)
    own = readings.drift_percent - common
    # If most pixels drift together, the sensor is not at rest and single pixels can't be judged.
    is_calm = abs(common) < 0.5 * _DRIFT_PERCENT
    yield (
        "drifting",
        is_calm & (np.abs(own) > _DRIFT_PERCENT),
        "drifts by {} % relative to the other pixels",
        own,
    )
    if known_ohm is not None:
        # A change common to all pixels is due to climate or load.
        change = relative_change_percent(readings.rest_ohm, rest_ohm=known_ohm)
        own = 100.0 * ((100.0 + change) / (100.0 + _median_of_working_pixels(change)) - 1.0)
        text = "differs by {} % from its calibrated rest value, relative to the other pixels"
        yield "changed", np.abs(own) > _CHANGED_PERCENT, text, own


def group_pixels(mask: BoolArray) -> Iterator[tuple[str, BoolArray]]:
    """Yield names and masks of groups of pixels: all, complete rows or columns, single ones.

    >>> mask = np.array([[True, True], [False, False], [True, False]])
    >>> [where for where, _ in group_pixels(mask)]
    ['row R0', 'R2 C0']
    """
    remaining = mask.copy()
    if mask.size > 1 and mask.all():
        yield "every pixel", remaining
        return
    for axis, name in ((1, "row R"), (0, "column C")):
        if mask.shape[axis] < 2:
            continue
        for line in np.flatnonzero(remaining.all(axis=axis)):
            part = np.zeros_like(mask)
            part[(line, slice(None)) if axis == 1 else (slice(None), line)] = True
            yield f"{name}{line}", part
            remaining &= ~part
    for row, col in np.argwhere(remaining):
        part = np.zeros_like(mask)
        part[row, col] = True
        yield pixel_name(row, col), part


def _median_of_working_pixels(values: FloatArray) -> float:
    """Return the median of the working pixels; NaN if there are none."""
    valid = values[np.isfinite(values) & (values != 0)]
    return float(np.median(valid)) if valid.size else math.nan


def find_end_readings(
    mean_counts: FloatArray, *, layout: ArrayLayout
) -> tuple[BoolArray, BoolArray]:
    """Return masks of the counts at the open and short ends of the range.

    A short pixel reads the resistance of its lines. Without held idle lines, the pixels that a
    `Sample` calls saturated are all at the short end.
    """
    divider = layout.divider
    top = divider.full_scale - 1
    line_counts = divider.full_scale * layout.line_ohm / (divider.reference_ohm + layout.line_ohm)
    if divider.taxel_leg == "upper":
        at_end = top - max(line_counts - 0.5, 0.0)
        return mean_counts <= _END_COUNTS, mean_counts >= at_end - _END_COUNTS
    return mean_counts >= top - _END_COUNTS, mean_counts <= line_counts + 0.5 + _END_COUNTS


def _count_drops_and_jumps(
    mean_counts: FloatArray, *, layout: ArrayLayout
) -> tuple[FloatArray, FloatArray]:
    """Count each pixel's drops to an end of the range and jumps within it."""
    at_end = np.logical_or(*find_end_readings(mean_counts, layout=layout))
    # A pixel near an end of the range reaches this end from noise alone, and is excluded.
    middle = np.median(mean_counts, axis=0)
    is_clear = (middle > 4) & (middle < layout.divider.full_scale - 5)
    drops = np.where(is_clear, at_end.sum(axis=0), 0.0)
    ohm = resistance_ohm(mean_counts, divider=layout.divider)
    usable = ~at_end & (ohm > 0)
    log_ohm = np.log(np.where(usable, ohm, 1.0))
    both = usable[1:] & usable[:-1]
    far = np.abs(np.diff(log_ohm, axis=0)) > math.log1p(_JUMP_PERCENT / 100.0)
    jumps = np.where(is_clear, (both & far).sum(axis=0), 0.0)
    return drops, jumps


def _find_stuck_pixels(
    mean_counts: FloatArray, steps_per_count: int, *, healthy: BoolArray, layout: ArrayLayout
) -> BoolArray:
    """Find constant pixels whose noise should be visible.

    A reading in the middle of a step stays constant while its noise is within half a step. The
    expected noise is the lowest noise of the other pixels, reduced for a less sensitive pixel.
    """
    sums = mean_counts * steps_per_count
    noise = np.std(np.diff(sums, axis=0), axis=0) / math.sqrt(2.0)
    constant = healthy & np.asarray(np.ptp(sums, axis=0) == 0)
    noisy = healthy & np.asarray(noise > 0)
    stuck: BoolArray = np.zeros(healthy.shape, dtype=np.bool_)
    if noisy.sum() < _MIN_OTHERS:
        return stuck
    fraction = np.median(mean_counts, axis=0) / layout.divider.full_scale
    sensitivity = fraction * (1.0 - fraction)
    quietest = np.flatnonzero(noisy.ravel())[np.argmin(noise[noisy])]
    for row, col in np.argwhere(constant):
        ratio = min(1.0, float(sensitivity[row, col] / sensitivity.ravel()[quietest]))
        expected = float(noise.ravel()[quietest]) * ratio
        p_constant = math.erf(0.5 / (expected * math.sqrt(2.0)))
        stuck[row, col] = p_constant ** len(sums) * layout.pixels < _STUCK_PROBABILITY
    return stuck
