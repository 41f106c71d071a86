"""The windows of a hold: peak (t_p), wait (t_a) and cut-off (t_c) of equation 3."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: The paper's t_a: right after the peak a faster process than the fitted one is at work (sec. 2.2).
WAIT_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class HoldWindow:
    """Where the peak of each hold is, and which samples an equation-3 fit may use.

    The samples of hold i are ``time_s[first[i]:]``. On shared sampling times they depend on the
    peak alone, so that holds with the same `peak` share one grid.
    """

    #: Shape (n_holds,). Index of the peak sample.
    peak: NDArray[np.intp]
    #: Shape (n_holds,). Its time, t_p.
    peak_s: NDArray[np.float64]
    #: Shape (n_holds,). Index of the first sample at or after t_p + t_a; the number of samples if
    #: there is none.
    first: NDArray[np.intp]

    def grids(self) -> Iterator[tuple[int, NDArray[np.intp]]]:
        """Yield each first sample that occurs, and which holds have it."""
        left = self.first
        while left.size:
            first = left[0]
            yield int(first), np.flatnonzero(self.first == first)
            left = left[left != first]


def peak_index(values: ArrayLike) -> NDArray[np.intp]:
    """Return the index of the peak, the extreme from which the signal moves farthest.

    Ohm and relative change fall after contact, other readings rise: with the extreme opposite to
    the direction of settling as the peak, nothing depends on sign, scale or where zero lies. Of
    equal extremes the earlier counts.

    Source: Paper, section 2.2: t_p is the time of the peak resistance within the cut-off.

    `values`, shape (..., n_times): samples up to the cut-off, at least one.

    A spike at contact, then settling below the value at rest; and the same upside down:

    >>> peak_index([[0, 5, -20, -30], [0, -5, 20, 30]]).tolist()
    [1, 1]
    """
    samples = np.asarray(values, dtype=np.float64)
    top, bottom = samples.argmax(axis=-1), samples.argmin(axis=-1)
    last = samples[..., -1]
    fallen = np.maximum.reduce(samples, axis=-1) - last
    risen = last - np.minimum.reduce(samples, axis=-1)
    later, earlier = np.maximum(top, bottom), np.minimum(top, bottom)
    down_first = (top <= bottom) == (fallen >= risen)
    peak: NDArray[np.intp] = np.where(down_first | (fallen == risen), earlier, later)
    return peak


def hold_window(time_s: ArrayLike, values: ArrayLike, *, wait_s: float = WAIT_S) -> HoldWindow:
    """Find the peak of each hold and the samples from t_p + t_a on.

    Source: Paper, equation 3.

    `time_s`, shape (n_times,): strictly increasing sampling times that the holds share, up to the
        cut-off t_c, seconds.
    `values`, shape (n_holds, n_times): samples.
    `wait_s`: t_a, counted from the peak.

    >>> window = hold_window([0.0, 0.2, 0.4, 0.8], [[1.0, 3.0, 2.0, 0.5]])
    >>> window.peak_s.tolist(), window.first.tolist()
    ([0.2], [3])
    """
    times = np.asarray(time_s, dtype=np.float64)
    peak = peak_index(values)
    peak_s = times[peak]
    # The slack takes sums like 0.2 + 0.5 against a sampling time printed as 0.7.
    first = times.searchsorted(peak_s + wait_s - 1e-9)
    return HoldWindow(peak=peak, peak_s=peak_s, first=first)
