"""States of a creeping sheet: its reading, its lag and its fall from the peak.

The response of a sheet to a force is partly immediate, and partly creep with a range of time
constants. One reading therefore corresponds to many forces, but a reading with its history to few.
The history consists of low-passed copies of the logarithm of the reading, updated exactly for a
reading held between samples, and of the fall from its recent maximum, which indicates unloading.
All states are causal. Differences from the copies are used instead of the copies, so that a gain of
the sheet changes only the first input.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray

#: Log-spaced, from one sample of a fast readout to the length of a press.
TIME_CONSTANTS_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
#: Added to the excess conductance before the logarithm: the paper's contact threshold of 10 %
#: (section 4.1), below which the reading has no information on force.
CONTACT_EXCESS = 0.1
#: Falls far below this (ln) are noise.
_FALL_SCALE = 0.05


def log_reading(excess: ArrayLike) -> FloatArray:
    """Return ln(excess conductance + 0.1), the input of `ForceStates`.

    Examples
    --------
    >>> log_reading([0.9, 9.9, -5.0]).round(2).tolist()
    [0.0, 2.3, -2.3]
    """
    return np.asarray(np.log(np.maximum(np.asarray(excess, dtype=float), 0.0) + CONTACT_EXCESS))


class ForceStates:
    """States of one sheet, updated sample by sample.

    The maximum decays with the longest of `TIME_CONSTANTS_S`.

    Examples
    --------
    >>> sheet = ForceStates()
    >>> sheet.step(0.0, 0.0).tolist() == [0.0] * 8
    True
    >>> sheet.step(1.0, 1.0).round(3).tolist()
    [1.0, 0.0, 0.0, 0.0, 0.036, 0.368, 0.717, 0.0]
    """

    def __init__(self) -> None:
        self._tau_s = np.array(TIME_CONSTANTS_S)
        self._time_s: float | None = None
        self._copies = np.zeros(len(self._tau_s))
        self._peak = 0.0

    def step(self, time_s: float, reading: float) -> FloatArray:
        """Process a reading and return the inputs of the force model.

        Parameters
        ----------
        time_s : float
            Time, not earlier than that of the last reading.
        reading : float
            Logarithm of the sheet's reading; see `log_reading`.

        Returns
        -------
        ndarray, shape (8,)
            The reading, its differences from the copies, ln(1 + fall / 0.05).

        Raises
        ------
        ValueError
            If time runs backwards.
        """
        if self._time_s is None:
            self._copies[:] = reading
            self._peak = reading
        else:
            elapsed_s = time_s - self._time_s
            if elapsed_s < 0:
                raise ValueError(f"time runs backwards: from {self._time_s} s to {time_s} s")
            fraction = -np.expm1(-elapsed_s / self._tau_s)
            self._copies += fraction * (reading - self._copies)
            self._peak = max(reading, self._peak + float(fraction[-1]) * (reading - self._peak))
        self._time_s = time_s
        fall = np.log1p((self._peak - reading) / _FALL_SCALE)
        return np.concatenate([[reading], reading - self._copies, [fall]])


def compute_states(time_s: ArrayLike, reading: ArrayLike) -> FloatArray:
    """Return the inputs at every sample of a recording, shape (n_times, 8).

    Parameters
    ----------
    time_s, reading : array_like, shape (n_times,)
        Arguments of `ForceStates.step`.
    """
    sheet = ForceStates()
    steps = zip(np.asarray(time_s).tolist(), np.asarray(reading).tolist(), strict=True)
    return np.array([sheet.step(*step) for step in steps]).reshape(-1, 2 + len(TIME_CONSTANTS_S))
