"""Time windows of a hold: peak (t_p), wait (t_a) and cut-off (t_c) of equation 3."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray

#: The paper's t_a: right after the peak a process faster than the fitted process dominates
#: (section 2.2).
WAIT_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldWindow:
    """Peak of each hold, and the samples for a fit of equation 3.

    The samples of hold i are ``time_s[first[i]:]``. With common sampling times they depend only on
    the peak, so that holds with the same `peak` share a time grid.
    """

    #: Shape (n_holds,). Index of the peak sample.
    peak: NDArray[np.intp]
    #: Shape (n_holds,). Time of the peak, t_p.
    peak_s: NDArray[np.float64]
    #: Shape (n_holds,). Index of the first sample at or after t_p + t_a; the number of samples if
    #: there is none.
    first: NDArray[np.intp]

    def group_by_first(self) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Yield each distinct first sample with the indices of its holds."""
        remaining = self.first
        while remaining.size:
            first = remaining[0]
            yield int(first), np.flatnonzero(self.first == first)
            remaining = remaining[remaining != first]


def find_peak(values: ArrayLike) -> NDArray[np.intp]:
    """Return the index of the peak, the extreme with the largest change after it.

    Ohm and relative change fall after contact, other readings rise. The peak is the extreme
    opposite to the direction of settling, so that the result does not depend on sign, scale or
    offset. Of equal extremes the earlier is the peak.

    Source: Paper, section 2.2: t_p is the time of the peak resistance within the cut-off.

    `values`, shape (..., n_times): samples up to the cut-off, at least one.

    A spike at contact, then settling below the rest value; and the same signal inverted:

    >>> find_peak([[0, 5, -20, -30], [0, -5, 20, 30]]).tolist()
    [1, 1]
    """
    samples = np.asarray(values, dtype=np.float64)
    last = samples[..., -1]
    return select_peak(
        samples.argmax(axis=-1),
        samples.argmin(axis=-1),
        fall=np.maximum.reduce(samples, axis=-1) - last,
        rise=last - np.minimum.reduce(samples, axis=-1),
    )


def select_peak(
    top: NDArray[np.intp], bottom: NDArray[np.intp], *, fall: FloatArray, rise: FloatArray
) -> NDArray[np.intp]:
    """Select the peak from the indices of the largest and the smallest sample; see `find_peak`.

    `fall`, `rise`: changes from the largest and from the smallest sample to the last sample.
    """
    is_top = (fall > rise) | ((fall == rise) & (top < bottom))
    return np.where(is_top, top, bottom)


def find_hold_window(time_s: ArrayLike, values: ArrayLike, *, wait_s: float = WAIT_S) -> HoldWindow:
    """Find the peak of each hold and the samples from t_p + t_a on.

    Source: Paper, equation 3.

    `time_s`, shape (n_times,): strictly increasing sampling times of all holds, up to the cut-off
        t_c, seconds.
    `values`, shape (n_holds, n_times): samples.
    `wait_s`: t_a, measured from the peak.

    >>> window = find_hold_window([0.0, 0.2, 0.4, 0.8], [[1.0, 3.0, 2.0, 0.5]])
    >>> window.peak_s.tolist(), window.first.tolist()
    ([0.2], [3])
    """
    times = np.asarray(time_s, dtype=np.float64)
    peak = find_peak(values)
    peak_s = times[peak]
    # The tolerance covers rounding, such as 0.2 + 0.5 compared with a sampling time of 0.7.
    first = times.searchsorted(peak_s + wait_s - 1e-9)
    return HoldWindow(peak=peak, peak_s=peak_s, first=first)
