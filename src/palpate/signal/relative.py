"""Load signals from resistances: rest baseline, relative change, sums over pixels.

Arrays have shape (..., rows, cols). An open pixel (infinite) or a pixel without a rest value yields
NaN, and the sums over pixels ignore NaN. A short pixel has at least the conductance of the
converter's last step. Its excess is infinite and is never ignored, because an unreadable load must
not count as no load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError

#: Contact threshold of the paper (section 4.1), percent of relative change.
CONTACT_PERCENT = -10.0
#: Largest trend and range of the pixels' mean at rest, percent. Actuation spikes and loads are far
#: above these limits, drift and noise below.
_REST_TREND_PERCENT, _REST_SPREAD_PERCENT = 1.0, 3.0
#: A mean this far below the earlier rest values indicates a load on the sensor.
_REST_FALL_PERCENT = -15.0
_MIN_FRAMES = 5
#: Scales the median absolute deviation to a standard deviation of normal noise.
_MAD_TO_SD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class RestBaseline:
    """Rest values: readings of the pixels without load."""

    #: Shape (rows, cols). Robust mean; NaN for a pixel with an open or short reading.
    rest_ohm: FloatArray
    #: Shape (rows, cols). Robust standard deviation of one frame, percent of `rest_ohm`.
    spread_percent: FloatArray
    #: Number of frames used.
    frames: int


def rest_baseline(resistance_ohm: ArrayLike, *, known_ohm: ArrayLike | None = None) -> RestBaseline:
    """Compute the rest values from frames without load.

    The mean over frames excludes readings more than three robust standard deviations from the
    median. Movement, settling or a touch causes a trend or a jump, and the frames are refused. The
    frames alone do not show a load that has settled; this requires earlier rest values.

    `resistance_ohm`, shape (frames, rows, cols): readings; at least five frames.
    `known_ohm`, shape (rows, cols): rest values of an earlier calibration.
    Raises `CalibrationError` if there are too few frames or no valid pixels, or if the sensor was
    loaded or moving.

    >>> rest = rest_baseline([[[1000.0, 2000.0]]] * 20)
    >>> rest.rest_ohm.tolist(), rest.spread_percent.tolist()
    ([[1000.0, 2000.0]], [[0.0, 0.0]])
    """
    ohm = np.asarray(resistance_ohm, dtype=np.float64)
    if ohm.ndim != 3 or ohm.shape[0] < _MIN_FRAMES:
        frames = ohm.shape[0] if ohm.ndim == 3 else 0
        raise CalibrationError(
            f"a rest baseline needs at least {_MIN_FRAMES} frames, got {frames}; record longer"
        )
    ohm = np.where(np.isfinite(ohm) & (ohm > 0), ohm, np.nan)
    ohm[:, np.isnan(ohm).any(axis=0)] = np.nan
    if np.isnan(ohm).all():
        raise CalibrationError("no valid pixel in the rest readings; check wiring and power")
    median = np.median(ohm, axis=0)
    sd = _MAD_TO_SD * np.median(np.abs(ohm - median), axis=0)
    is_inlier = np.abs(ohm - median) <= np.maximum(3.0 * sd, 1e-9 * median)
    rest_ohm = np.where(is_inlier, ohm, 0.0).sum(axis=0) / np.maximum(is_inlier.sum(axis=0), 1)
    rest_ohm = np.where(np.isnan(median), np.nan, rest_ohm)
    _check_at_rest(relative_change_percent(ohm, rest_ohm=rest_ohm))
    if known_ohm is not None:
        check_unloaded(rest_ohm, known_ohm=known_ohm)
    return RestBaseline(
        rest_ohm=rest_ohm, spread_percent=100.0 * sd / rest_ohm, frames=int(ohm.shape[0])
    )


def relative_change_percent(resistance_ohm: ArrayLike, *, rest_ohm: ArrayLike) -> FloatArray:
    """Return 100 (R / R_rest - 1), percent (paper, equation 1).

    `resistance_ohm`, shape (..., rows, cols): readings; infinite (open) yields NaN.
    `rest_ohm`, shape (rows, cols): rest values; NaN or zero yields NaN.

    >>> relative_change_percent([[500.0, 1000.0]], rest_ohm=[[1000.0, 1000.0]]).tolist()
    [[-50.0, 0.0]]
    """
    resistance, rest = np.asarray(resistance_ohm, float), np.asarray(rest_ohm, float)
    usable = np.isfinite(resistance) & (rest > 0)
    ratio = np.where(usable, resistance, 1.0) / np.where(rest > 0, rest, 1.0)
    return np.where(usable, 100.0 * (ratio - 1.0), np.nan)


def excess_conductance(resistance_ohm: ArrayLike, *, rest_ohm: ArrayLike) -> FloatArray:
    """Return G / G_rest - 1 = R_rest / R - 1, a ratio.

    The excess conductance still rises with load where the relative change approaches -100 %.

    `resistance_ohm`, shape (..., rows, cols): readings; infinite (open) yields NaN, zero (short)
        infinity.
    `rest_ohm`, shape (rows, cols): rest values; NaN or zero yields NaN.

    >>> excess_conductance([[500.0, 1000.0, 0.0]], rest_ohm=[[1000.0, 1000.0, 1000.0]]).tolist()
    [[1.0, 0.0, inf]]
    """
    resistance, rest = np.asarray(resistance_ohm, float), np.asarray(rest_ohm, float)
    usable = np.isfinite(resistance) & (resistance >= 0) & (rest > 0)
    short = usable & (resistance == 0)
    excess = rest / np.where(usable & ~short, resistance, 1.0) - 1.0
    return np.where(short, np.inf, np.where(usable, excess, np.nan))


def mean_change(change_percent: ArrayLike) -> FloatArray:
    """Return the mean over all pixels (the paper's aggregate): (..., rows, cols) to (...).

    >>> mean_change([[-50.0, 0.0], [float("nan"), -10.0]]).item()
    -20.0
    """
    change = np.asarray(change_percent, float)
    known = ~np.isnan(change)
    if change.size and known.all():
        # The common case, several times as fast.
        return np.asarray(change.mean(axis=(-2, -1)))
    count = known.sum(axis=(-2, -1))
    total = np.where(known, change, 0.0).sum(axis=(-2, -1))
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def finger_means(change_percent: ArrayLike, *, finger_of_row: Sequence[int]) -> FloatArray:
    """Return the mean over each finger's pixels: (..., rows, cols) to (..., fingers).

    >>> finger_means([[-50.0, -30.0], [0.0, -2.0]], finger_of_row=(0, 1)).tolist()
    [-40.0, -1.0]
    """
    change = np.asarray(change_percent, float)
    means = [mean_change(change[..., rows, :]) for rows in _rows_by_finger(tuple(finger_of_row))]
    return np.stack(means, axis=-1)


@cache
def _rows_by_finger(finger_of_row: tuple[int, ...]) -> list[list[int]]:
    """Return the rows of each finger, in the order of the finger numbers."""
    return [
        [row for row, other in enumerate(finger_of_row) if other == finger]
        for finger in sorted(set(finger_of_row))
    ]


def largest_change(change_percent: ArrayLike) -> FloatArray:
    """Return the largest fall of any pixel: shape (..., rows, cols) to (...).

    >>> largest_change([[-50.0, 3.0]]).item()
    -50.0
    """
    change = np.asarray(change_percent, float)
    lowest = np.min(np.where(np.isnan(change), np.inf, change), axis=(-2, -1))
    return np.where(np.isinf(lowest), np.nan, lowest)


def total_excess(excess: ArrayLike) -> FloatArray:
    """Return the sum of excess conductances: (..., rows, cols) to (...); NaN without a reading.

    For a nearly linear law the sum hardly depends on the distribution of the force over the pixels.

    >>> total_excess([[1.0, 0.0], [float("nan"), 2.5]]).item()
    3.5
    >>> total_excess([[1.0, float("inf")]]).item()
    inf
    """
    values = np.asarray(excess, float)
    total = np.nansum(values, axis=(-2, -1))
    return np.where(np.isnan(values).all(axis=(-2, -1)), np.nan, total)


def _check_at_rest(change_percent: FloatArray) -> None:
    """Raise `CalibrationError` if relative changes, shape (frames, rows, cols), show no rest."""
    overall = mean_change(change_percent)
    third = max(overall.size // 3, 1)
    trend = float(np.median(overall[-third:]) - np.median(overall[:third]))
    if abs(trend) > _REST_TREND_PERCENT:
        raise CalibrationError(
            f"the readings drifted by {trend:+.1f} % at rest (at most "
            f"{_REST_TREND_PERCENT:g} %): the sensor was loaded or still settling; wait and repeat"
        )
    smooth = overall
    if overall.size >= 3:
        smooth = np.median(np.lib.stride_tricks.sliding_window_view(overall, 3), axis=-1)
    span = float(np.ptp(smooth))
    if span > _REST_SPREAD_PERCENT:
        raise CalibrationError(
            f"the readings jumped by {span:.1f} % at rest (at most {_REST_SPREAD_PERCENT:g} %): "
            "the fingers moved or the sensor was touched; repeat at rest"
        )


def check_unloaded(rest_ohm: ArrayLike, *, known_ohm: ArrayLike) -> None:
    """Raise `CalibrationError` if the rest values show a load on the sensor.

    `rest_ohm`, `known_ohm`, shape (rows, cols): present rest values, and those of an earlier
        calibration. The limit is a mean of 15 % below the earlier values.

    >>> check_unloaded([[950.0, 1980.0]], known_ohm=[[1000.0, 2000.0]])
    """
    fall = float(mean_change(relative_change_percent(rest_ohm, rest_ohm=known_ohm)))
    if fall < _REST_FALL_PERCENT:
        raise CalibrationError(
            f"the rest values are {-fall:.0f} % below the earlier values: there is a load on the "
            "sensor; remove it, or calibrate again if the sensor was changed"
        )
