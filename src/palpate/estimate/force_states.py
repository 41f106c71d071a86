"""States of a creeping sheet: its reading, its lag and its fall from the peak.

A sheet answers a force at once and through creep with a spread of time constants. One reading
therefore corresponds to many forces; the reading together with its history corresponds to few. The
history is kept as low-passed copies of the logarithm of the reading, advanced exactly for a reading
that is held between samples, and as the fall from its recent maximum, which is the sign of
unloading. Everything is causal, and differences are used instead of the copies themselves, so that
a gain of the sheet shifts the first input only.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray

#: Log-spaced, from one sample of a fast readout to the length of a press.
TIME_CONSTANTS_S = (0.01, 0.03, 0.1, 0.3, 1.0, 3.0)
#: Added to the excess conductance before the logarithm: a change of 10 % is the paper's contact
#: threshold (section 4.1); below it the sheet shows nothing of force.
CONTACT_EXCESS = 0.1
#: Falls well below this (ln) are noise.
_FALL_SCALE = 0.05


def log_reading(excess: ArrayLike) -> FloatArray:
    """Return ln(excess conductance + 0.1), what `ForceStates` follows.

    Examples
    --------
    >>> log_reading([0.9, 9.9, -5.0]).round(2).tolist()
    [0.0, 2.3, -2.3]
    """
    return np.asarray(np.log(np.maximum(np.asarray(excess, dtype=float), 0.0) + CONTACT_EXCESS))


class ForceStates:
    """The states of one sheet, advanced sample by sample.

    The maximum fades with the last of `TIME_CONSTANTS_S`.

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
        """Take a reading and return the inputs of the force model.

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        reading : float
            Logarithm of what the sheet reads; see `log_reading`.

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
                raise ValueError(f"time runs backwards: {time_s} s after {self._time_s} s")
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
        As `ForceStates.step` takes them.
    """
    sheet = ForceStates()
    steps = zip(np.asarray(time_s).tolist(), np.asarray(reading).tolist(), strict=True)
    return np.array([sheet.step(*step) for step in steps]).reshape(-1, 2 + len(TIME_CONSTANTS_S))
