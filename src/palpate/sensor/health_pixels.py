"""Faults of single pixels, from a stretch of frames at rest."""

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
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.circuit import resistance_ohm, resolution_ohm
from palpate.signal.relative import relative_change_percent

BoolArray: TypeAlias = NDArray[np.bool_]
PixelVerdict: TypeAlias = tuple[str, BoolArray, str, FloatArray]

#: Within this many counts of an end of the range nothing is read but the converter's noise. A pixel
#: that rests there is dead; one that goes there now and then has a loose joint.
_END_COUNTS, _FEWEST_DROPOUTS = 1.0, 2
#: Jumps from one frame to the next that no sheet at rest makes; a touch or a spike makes two.
_JUMP_PERCENT, _FEWEST_JUMPS = 20.0, 3
#: Noise of one frame: a fifth of the paper's contact threshold, so that five deviations reach it;
#: or far above the other pixels'. Below one count it is the converter's step, not noise.
_NOISY_PERCENT, _NOISY_RATIO, _QUIET_PERCENT, _COUNT = 2.0, 5.0, 0.5, 1.0
#: Change from the first to the last third of the stretch, beyond what all pixels share.
_DRIFT_PERCENT = 2.0
#: A healthy pixel may stand still by this chance at most before it is called stuck.
_STUCK_CHANCE, _FEWEST_OTHERS = 1e-6, 3
#: Rest resistance against the median of the pixels, and against the calibration's.
_FAINT_RATIO, _CHANGED_PERCENT = 10.0, 30.0
#: 90 % of the differences of two normal readings lie within this many standard deviations.
_Q90_OF_DIFFERENCES = 1.6449 * math.sqrt(2.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelReadings:
    """Statistics of each pixel over the stretch; arrays have shape (rows, cols)."""

    #: Median resistance: inf for an open pixel, 0 for a short one.
    rest_ohm: FloatArray
    #: Standard deviation of one frame, slow changes left out; NaN for dead pixels.
    noise_percent: FloatArray
    #: Change from the first to the last third of the stretch; NaN for dead pixels.
    drift_percent: FloatArray
    #: Change of the reading by one count; NaN for dead pixels.
    count_percent: FloatArray


def measure_pixels(mean_counts: FloatArray, *, layout: ArrayLayout) -> PixelReadings:
    """Measure rest value, noise, drift and resolution of each pixel.

    `mean_counts`: shape (frames, rows, cols).
    """
    ohm = pixel_resistance_ohm(mean_counts, layout=layout)
    at_open, at_short = at_ends(np.median(mean_counts, axis=0), layout=layout)
    rest_ohm = np.where(at_open, np.inf, np.where(at_short, 0.0, np.median(ohm, axis=0)))
    alive = np.isfinite(rest_ohm) & (rest_ohm > 0)
    safe_rest = np.where(alive, rest_ohm, 1.0)
    change = relative_change_percent(ohm, rest_ohm=np.where(alive, rest_ohm, np.nan))
    change = np.where(np.isnan(change), 0.0, change)
    steps = np.abs(np.diff(change, axis=0))
    third = max(len(ohm) // 3, 1)
    drift = np.mean(change[-third:], axis=0) - np.mean(change[:third], axis=0)
    count = 100.0 * resolution_ohm(safe_rest, divider=layout.divider) / safe_rest
    noise = np.quantile(steps, 0.9, axis=0) / _Q90_OF_DIFFERENCES
    return PixelReadings(
        rest_ohm=rest_ohm,
        noise_percent=np.where(alive, noise, np.nan),
        drift_percent=np.where(alive, drift, np.nan),
        count_percent=np.where(alive, count, np.nan),
    )


def judge_pixels(
    mean_counts: FloatArray,
    *,
    steps_per_count: int,
    readings: PixelReadings,
    layout: ArrayLayout,
    known_ohm: FloatArray | None = None,
) -> Iterator[PixelVerdict]:
    """Yield code, pixels, text and its number, the most severe fault first.

    `mean_counts`: shape (frames, rows, cols).
    `steps_per_count`: conversions summed per reading: how many steps there are to a count.
    `known_ohm`, shape (rows, cols): rest values of the calibration.
    """
    nothing = np.zeros((layout.rows, layout.cols))
    yield "open", np.isinf(readings.rest_ohm), "reads open: no current flows", nothing
    yield "short", readings.rest_ohm == 0.0, "reads short: no resistance at all", nothing
    alive = np.isfinite(readings.noise_percent)
    ratio = np.where(alive, readings.rest_ohm, 0.0) / _typical_value(readings.rest_ohm)
    yield "faint", ratio > _FAINT_RATIO, "reads {} times the resistance of the others", ratio
    noise = readings.noise_percent
    loud = (noise > _NOISY_PERCENT) | (
        (noise > _NOISY_RATIO * _typical_value(noise)) & (noise > _QUIET_PERCENT)
    )
    drops, jumps = _count_interruptions(mean_counts, layout=layout)
    loose = (drops >= _FEWEST_DROPOUTS) | ((jumps >= _FEWEST_JUMPS) & ~loud)
    yield "loose", loose, "drops out or jumps {} times in the stretch", drops + jumps
    loud &= noise >= _COUNT * readings.count_percent
    yield "noisy", loud, "noise of one frame is {} %", noise
    stuck = _find_stuck(mean_counts, steps_per_count, sound=alive & ~loose, layout=layout)
    yield "stuck", stuck, "never moves, though the other pixels' noise should move it", nothing
    shared = _typical_value(readings.drift_percent)
    own = readings.drift_percent - shared
    # When most pixels move together the sensor is not at rest, and no pixel can be singled out.
    calm = abs(shared) < 0.5 * _DRIFT_PERCENT
    yield (
        "drifting",
        calm & (np.abs(own) > _DRIFT_PERCENT),
        "drifts by {} % more than the others",
        own,
    )
    if known_ohm is not None:
        # What all pixels share is climate or load.
        change = relative_change_percent(readings.rest_ohm, rest_ohm=known_ohm)
        own = 100.0 * ((100.0 + change) / (100.0 + _typical_value(change)) - 1.0)
        text = "rests {} % from its calibrated value, more than the others"
        yield "changed", np.abs(own) > _CHANGED_PERCENT, text, own


def group_pixels(mask: BoolArray) -> Iterator[tuple[str, BoolArray]]:
    """Yield the pixels of a mask by name: all, whole rows or columns, single ones.

    >>> mask = np.array([[True, True], [False, False], [True, False]])
    >>> [where for where, _ in group_pixels(mask)]
    ['row R0', 'R2 C0']
    """
    left = mask.copy()
    if mask.size > 1 and mask.all():
        yield "every pixel", left
        return
    for axis, name in ((1, "row R"), (0, "column C")):
        if mask.shape[axis] < 2:
            continue
        for line in np.flatnonzero(left.all(axis=axis)):
            part = np.zeros_like(mask)
            part[(line, slice(None)) if axis == 1 else (slice(None), line)] = True
            yield f"{name}{line}", part
            left &= ~part
    for row, col in np.argwhere(left):
        part = np.zeros_like(mask)
        part[row, col] = True
        yield pixel_name(row, col), part


def _typical_value(values: FloatArray) -> float:
    """Return the median of the working pixels; NaN without one."""
    kept = values[np.isfinite(values) & (values != 0)]
    return float(np.median(kept)) if kept.size else math.nan


def at_ends(mean_counts: FloatArray, *, layout: ArrayLayout) -> tuple[BoolArray, BoolArray]:
    """Return masks of counts at the open end and the short end of the range."""
    at_ground = np.asarray(mean_counts <= _END_COUNTS)
    at_supply = np.asarray(mean_counts >= layout.divider.full_scale - 1 - _END_COUNTS)
    upper = layout.divider.taxel_leg == "upper"
    return (at_ground, at_supply) if upper else (at_supply, at_ground)


def _count_interruptions(
    mean_counts: FloatArray, *, layout: ArrayLayout
) -> tuple[FloatArray, FloatArray]:
    """Count each pixel's drops to an end of the range and jumps within it."""
    dead = np.logical_or(*at_ends(mean_counts, layout=layout))
    # Near an end of the range a reading touches it by noise alone.
    middle = np.median(mean_counts, axis=0)
    away = (middle > 4) & (middle < layout.divider.full_scale - 5)
    drops = np.where(away, dead.sum(axis=0), 0.0)
    ohm = resistance_ohm(mean_counts, divider=layout.divider)
    usable = ~dead & (ohm > 0)
    log_ohm = np.log(np.where(usable, ohm, 1.0))
    both = usable[1:] & usable[:-1]
    far = np.abs(np.diff(log_ohm, axis=0)) > math.log1p(_JUMP_PERCENT / 100.0)
    jumps = np.where(away, (both & far).sum(axis=0), 0.0)
    return drops, jumps


def _find_stuck(
    mean_counts: FloatArray, steps_per_count: int, *, sound: BoolArray, layout: ArrayLayout
) -> BoolArray:
    """Find pixels without noise where that of the others should show.

    A reading in the middle of a step stays there while its noise is within half a step. The noise
    is taken as the least of the moving pixels', less where this one is less sensitive.
    """
    sums = mean_counts * steps_per_count
    noise = np.std(np.diff(sums, axis=0), axis=0) / math.sqrt(2.0)
    still = sound & np.asarray(np.ptp(sums, axis=0) == 0)
    moving = sound & np.asarray(noise > 0)
    stuck: BoolArray = np.zeros(sound.shape, dtype=np.bool_)
    if moving.sum() < _FEWEST_OTHERS:
        return stuck
    share = np.median(mean_counts, axis=0) / layout.divider.full_scale
    sensitivity = share * (1.0 - share)
    quietest = np.flatnonzero(moving.ravel())[np.argmin(noise[moving])]
    for row, col in np.argwhere(still):
        weaker = min(1.0, float(sensitivity[row, col] / sensitivity.ravel()[quietest]))
        expected = float(noise.ravel()[quietest]) * weaker
        stays = math.erf(0.5 / (expected * math.sqrt(2.0)))
        stuck[row, col] = stays ** len(sums) * layout.pixels < _STUCK_CHANCE
    return stuck
