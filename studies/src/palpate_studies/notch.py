"""Filters against pick-up from the mains, causal as a live stream needs them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import iirnotch, lfilter, lfilter_zi

from palpate.arrays import FloatArray


def notch(
    values: ArrayLike, *, rate_hz: float, mains_hz: float, quality: float = 2.0
) -> FloatArray:
    """Take one frequency out of an evenly sampled signal.

    Above half the sampling rate the mains is seen at another frequency, down to 0 Hz; a notch is
    then no remedy, and this refuses.

    Parameters
    ----------
    values : array_like, shape (n_times,)
        Signal; before its first sample it counts as constant.
    rate_hz, mains_hz : float
        Sampling rate, and the frequency to take out.
    quality : float
        Frequency over the width of the notch: a wider notch rings for less time.

    Raises
    ------
    ValueError
        If the rate is not above twice the frequency.

    Examples
    --------
    >>> time_s = np.arange(500) / 250
    >>> hum = np.sin(2 * np.pi * 50 * time_s)
    >>> bool(abs(notch(3.0 + hum, rate_hz=250, mains_hz=50)[100:] - 3.0).max() < 1e-6)
    True
    """
    if rate_hz <= 2.0 * mains_hz:
        raise ValueError(
            f"{mains_hz:g} Hz can't be taken out of a signal sampled at {rate_hz:g} Hz: "
            "sample faster than twice that, or filter before the converter"
        )
    signal = np.asarray(values, dtype=np.float64)
    numerator, denominator = iirnotch(mains_hz, quality, fs=rate_hz)
    start = lfilter_zi(numerator, denominator) * signal[0]
    filtered, _ = lfilter(numerator, denominator, signal, zi=start)
    return np.asarray(filtered, dtype=np.float64)
