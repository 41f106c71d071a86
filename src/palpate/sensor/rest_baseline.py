"""Rest values of the pixels, from frames without load."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.sensor.findings import FSR_AT_REST
from palpate.sensor.sample import relative_change_percent
from palpate.signal.relative import mean_change

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
        raise CalibrationError(
            f"no valid pixel in the rest readings; check wiring and power; {FSR_AT_REST}"
        )
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
