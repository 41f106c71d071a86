"""Rest values of the pixels, from frames without load."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, NoiseError
from palpate.sensor.findings import FSR_AT_REST
from palpate.sensor.sample import relative_change_percent
from palpate.signal.relative import mean_change

#: Largest trend and range of the pixels' mean at rest, percent. Actuation spikes and loads are far
#: above these limits, drift and noise below.
_REST_TREND_PERCENT, _REST_SPREAD_PERCENT = 1.0, 3.0
#: A running mean is over so many frames that the range of white noise is within this fraction of
#: the allowed one. A trend within this many standard deviations of noise is no drift.
_NOISE_FRACTION, _TREND_SIGMAS = 2.0 / 3.0, 4.0
#: Fraction of normally distributed values within one standard deviation.
_WITHIN_SD = 0.6827
#: Standard deviation of a median relative to that of a mean.
_MEDIAN_SD = 1.2533
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
    median. Movement, settling or a touch causes a trend or a jump beyond the noise, and the frames
    are refused. The frames alone do not show a load that has settled; this requires earlier rest
    values.

    `resistance_ohm`, shape (frames, rows, cols): readings; at least five frames.
    `known_ohm`, shape (rows, cols): rest values of an earlier calibration.
    Raises `CalibrationError` if there are too few frames or no valid pixels, or if the sensor was
    loaded or moving; `NoiseError` if the noise hides whether it was.

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
    """Raise `CalibrationError` if relative changes, shape (frames, rows, cols), show no rest.

    White noise is averaged, so that a longer measurement is not refused more often.
    """
    overall = mean_change(change_percent)
    third = max(overall.size // 3, 1)
    # Drift and a touch hardly change second differences; those of noise have sqrt(6) times its sd.
    sd = float(np.quantile(np.abs(np.diff(overall, 2)), _WITHIN_SD)) / math.sqrt(6.0)
    # The expected range of N independent normal values is below 2 sd sqrt(2 ln N).
    noise_range = 2.0 * sd * math.sqrt(2.0 * math.log(overall.size))
    needed = math.ceil(max(noise_range / (_NOISE_FRACTION * _REST_SPREAD_PERCENT), 1.0) ** 2)
    frames = min(needed, third)
    trend = float(np.median(overall[-third:]) - np.median(overall[:third]))
    trend_sd = _MEDIAN_SD * sd * math.sqrt(2.0 / third)
    if abs(trend) > (allowed := max(_REST_TREND_PERCENT, _TREND_SIGMAS * trend_sd)):
        raise CalibrationError(
            f"the readings drifted by {trend:+.2f} % at rest (at most {allowed:.2f} %): the "
            "sensor was loaded or still settling; wait a minute without load, and repeat"
        )
    smooth = np.median(np.lib.stride_tricks.sliding_window_view(overall, 3), axis=-1)
    means = np.convolve(smooth, np.full(frames, 1.0 / frames), mode="valid")
    # A short touch is found if it is larger than the noise of a frame, a longer one in the means.
    short, long = float(np.ptp(smooth)), float(np.ptp(means))
    if short > (allowed := max(_REST_SPREAD_PERCENT, noise_range)):
        raise _jump_error(short, allowed)
    if max(long, abs(trend)) <= _REST_SPREAD_PERCENT:
        return
    if needed > frames:
        raise NoiseError(
            f"the noise is too large: the mean of all pixels scatters by {sd:.1f} % from frame to "
            f"frame, which hides a touch even in a mean of {frames} frames; average more "
            "conversions in the board's sketch, use shorter wires, or measure longer"
        )
    raise _jump_error(long, _REST_SPREAD_PERCENT)


def _jump_error(jump_percent: float, allowed_percent: float) -> CalibrationError:
    return CalibrationError(
        f"the readings jumped by {jump_percent:.2f} % at rest (at most {allowed_percent:.2f} %): "
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
