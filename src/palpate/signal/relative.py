"""From ohm to what pixels show about load: rest baseline, relative change, sums over pixels.

Arrays have shape (..., rows, cols). A pixel that reads open (infinite) or has no rest value gives
NaN, and the sums over pixels leave NaN out. A pixel that reads short has at least the conductance
of the converter's last step: its excess is infinite, never left out, because a load that can't be
read must not count as none.
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
#: A stretch counts as rest if the pixels' mean moves by no more than this over it, and no pixel
#: spreads more, in percent. Actuation spikes and loads are far above, drift and noise below.
_REST_TREND_PERCENT, _REST_SPREAD_PERCENT = 1.0, 3.0
#: A rest value this far below the one known before means that something presses on the sensor.
_REST_FALL_PERCENT = -15.0
_FEWEST_FRAMES = 5
#: Scales the median absolute deviation to a standard deviation of normal noise.
_MAD_TO_SD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class RestBaseline:
    """Rest values: each pixel's reading with nothing on it."""

    #: Shape (rows, cols). Robust mean; NaN for pixels that read open or short.
    rest_ohm: FloatArray
    #: Shape (rows, cols). Robust standard deviation of one frame, percent of `rest_ohm`.
    spread_percent: FloatArray
    #: How many frames it rests on.
    frames: int


def rest_baseline(resistance_ohm: ArrayLike, *, known_ohm: ArrayLike | None = None) -> RestBaseline:
    """Take the rest values from a stretch of frames, or refuse.

    The mean over frames leaves out what lies more than three robust standard deviations from the
    median. A stretch in which the sensor was moving, settling or touched shows as a trend or a
    jump, and is refused. A load that has long settled can't be distinguished from rest by the
    stretch alone: give the rest values known before.

    `resistance_ohm`, shape (frames, rows, cols): readings; at least five frames.
    `known_ohm`, shape (rows, cols): rest values of an earlier calibration.
    Raises `CalibrationError` if the stretch is too short, no pixel reads, or the sensor was loaded
    or moving.

    >>> rest = rest_baseline([[[1000.0, 2000.0]]] * 20)
    >>> rest.rest_ohm.tolist(), rest.spread_percent.tolist()
    ([[1000.0, 2000.0]], [[0.0, 0.0]])
    """
    ohm = np.asarray(resistance_ohm, dtype=np.float64)
    if ohm.ndim != 3 or ohm.shape[0] < _FEWEST_FRAMES:
        frames = ohm.shape[0] if ohm.ndim == 3 else 0
        raise CalibrationError(
            f"a rest baseline needs at least {_FEWEST_FRAMES} frames, got {frames}; record longer"
        )
    ohm = np.where(np.isfinite(ohm) & (ohm > 0), ohm, np.nan)
    ohm[:, np.isnan(ohm).any(axis=0)] = np.nan
    if np.isnan(ohm).all():
        raise CalibrationError("no pixel reads in the rest stretch; check wiring and power")
    middle = np.median(ohm, axis=0)
    sd = _MAD_TO_SD * np.median(np.abs(ohm - middle), axis=0)
    kept = np.abs(ohm - middle) <= np.maximum(3.0 * sd, 1e-9 * middle)
    rest_ohm = np.where(kept, ohm, 0.0).sum(axis=0) / np.maximum(kept.sum(axis=0), 1)
    rest_ohm = np.where(np.isnan(middle), np.nan, rest_ohm)
    _refuse_unrest(relative_change_percent(ohm, rest_ohm=rest_ohm))
    if known_ohm is not None:
        refuse_load(rest_ohm, known_ohm=known_ohm)
    return RestBaseline(
        rest_ohm=rest_ohm, spread_percent=100.0 * sd / rest_ohm, frames=int(ohm.shape[0])
    )


def relative_change_percent(resistance_ohm: ArrayLike, *, rest_ohm: ArrayLike) -> FloatArray:
    """Return 100 (R / R_rest - 1), percent (paper, equation 1).

    `resistance_ohm`, shape (..., rows, cols): readings; infinite (open) gives NaN.
    `rest_ohm`, shape (rows, cols): rest values; NaN or zero gives NaN.

    >>> relative_change_percent([[500.0, 1000.0]], rest_ohm=[[1000.0, 1000.0]]).tolist()
    [[-50.0, 0.0]]
    """
    resistance, rest = np.asarray(resistance_ohm, float), np.asarray(rest_ohm, float)
    usable = np.isfinite(resistance) & (rest > 0)
    ratio = np.where(usable, resistance, 1.0) / np.where(rest > 0, rest, 1.0)
    return np.where(usable, 100.0 * (ratio - 1.0), np.nan)


def excess_conductance(resistance_ohm: ArrayLike, *, rest_ohm: ArrayLike) -> FloatArray:
    """Return G / G_rest - 1 = R_rest / R - 1, a ratio.

    Where the relative change runs into -100 %, the excess conductance keeps rising with load.

    `resistance_ohm`, shape (..., rows, cols): readings; infinite (open) gives NaN, zero (short)
        infinity.
    `rest_ohm`, shape (rows, cols): rest values; NaN or zero gives NaN.

    >>> excess_conductance([[500.0, 1000.0, 0.0]], rest_ohm=[[1000.0, 1000.0, 1000.0]]).tolist()
    [[1.0, 0.0, inf]]
    """
    resistance, rest = np.asarray(resistance_ohm, float), np.asarray(rest_ohm, float)
    usable = np.isfinite(resistance) & (resistance >= 0) & (rest > 0)
    short = usable & (resistance == 0)
    excess = rest / np.where(usable & ~short, resistance, 1.0) - 1.0
    return np.where(short, np.inf, np.where(usable, excess, np.nan))


def mean_change(change_percent: ArrayLike) -> FloatArray:
    """Return the mean over all pixels: the paper's aggregate. Shape (..., rows, cols) to (...).

    >>> mean_change([[-50.0, 0.0], [float("nan"), -10.0]]).item()
    -20.0
    """
    return _mean_over(np.asarray(change_percent, float), axis=(-2, -1))


def finger_means(change_percent: ArrayLike, *, finger_of_row: Sequence[int]) -> FloatArray:
    """Return the mean of each finger's pixels: shape (..., rows, cols) to (..., fingers).

    >>> finger_means([[-50.0, -30.0], [0.0, -2.0]], finger_of_row=(0, 1)).tolist()
    [-40.0, -1.0]
    """
    change = np.asarray(change_percent, float)
    each = [
        _mean_over(change[..., rows, :], axis=(-2, -1))
        for rows in _rows_by_finger(tuple(finger_of_row))
    ]
    return np.stack(each, axis=-1)


@cache
def _rows_by_finger(finger_of_row: tuple[int, ...]) -> list[list[int]]:
    """Return the rows of each finger, in the order of the fingers' numbers."""
    return [
        [row for row, other in enumerate(finger_of_row) if other == finger]
        for finger in sorted(set(finger_of_row))
    ]


def largest_change(change_percent: ArrayLike) -> FloatArray:
    """Return the change of the pixel that fell most: shape (..., rows, cols) to (...).

    >>> largest_change([[-50.0, 3.0]]).item()
    -50.0
    """
    change = np.asarray(change_percent, float)
    lowest = np.min(np.where(np.isnan(change), np.inf, change), axis=(-2, -1))
    return np.where(np.isinf(lowest), np.nan, lowest)


def total_excess(excess: ArrayLike) -> FloatArray:
    """Return the sum of excess conductances: (..., rows, cols) to (...); NaN without a reading.

    It hardly depends on how a force spreads over the pixels, as long as the law is near linear.

    >>> total_excess([[1.0, 0.0], [float("nan"), 2.5]]).item()
    3.5
    >>> total_excess([[1.0, float("inf")]]).item()
    inf
    """
    values = np.asarray(excess, float)
    total = np.nansum(values, axis=(-2, -1))
    return np.where(np.isnan(values).all(axis=(-2, -1)), np.nan, total)


def _mean_over(values: FloatArray, *, axis: tuple[int, int]) -> FloatArray:
    """Return the mean that leaves NaN out, NaN where nothing is left."""
    known = ~np.isnan(values)
    count = known.sum(axis=axis)
    total = np.where(known, values, 0.0).sum(axis=axis)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _refuse_unrest(change_percent: FloatArray) -> None:
    """Raise if a stretch of relative changes, shape (frames, rows, cols), is not rest."""
    overall = mean_change(change_percent)
    third = max(overall.size // 3, 1)
    trend = float(np.median(overall[-third:]) - np.median(overall[:third]))
    if abs(trend) > _REST_TREND_PERCENT:
        raise CalibrationError(
            f"the sensor moved by {trend:+.1f} % during the rest stretch (at most "
            f"{_REST_TREND_PERCENT:g} %): it was loaded or still settling; leave it and repeat"
        )
    smooth = overall
    if overall.size >= 3:
        smooth = np.median(np.lib.stride_tricks.sliding_window_view(overall, 3), axis=-1)
    reach = float(np.ptp(smooth))
    if reach > _REST_SPREAD_PERCENT:
        raise CalibrationError(
            f"the sensor jumped by {reach:.1f} % during the rest stretch (at most "
            f"{_REST_SPREAD_PERCENT:g} %): the fingers moved or it was touched; repeat at rest"
        )


def refuse_load(rest_ohm: ArrayLike, *, known_ohm: ArrayLike) -> None:
    """Refuse rest values so far below those known before that something must be pressing.

    `rest_ohm`, `known_ohm`, shape (rows, cols): those of now, and of an earlier calibration.
    Raises `CalibrationError` if they lie 15 % below.

    >>> refuse_load([[950.0, 1980.0]], known_ohm=[[1000.0, 2000.0]])
    """
    fall = float(mean_change(relative_change_percent(rest_ohm, rest_ohm=known_ohm)))
    if fall < _REST_FALL_PERCENT:
        raise CalibrationError(
            f"the rest values are {-fall:.0f} % below the known ones: something presses on the "
            "sensor; take it away, or calibrate again if the sensor was changed"
        )
