"""What a creeping sheet remembers: low-passed copies of its log conductance, and its last fall.

The sheet is taken as log-linear: ln conductance answers ln force at once and through creep with a
spread of time constants. The inverse of such a system is of the same kind, so ln force is a
weighted sum of ln conductance and of low-passed copies of it; `observer` learns the weights.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray: TypeAlias = NDArray[np.float64]

#: Log-spaced, from a few samples of a slow readout to the length of a grasp.
TIME_CONSTANTS_S = (0.1, 0.3, 1.0, 3.0)
#: Added to the excess conductance before the logarithm: a change of 10 % is the paper's contact
#: threshold (section 4.1); below it the sheet says nothing of force.
CONTACT_EXCESS = 0.1
#: A fall of log conductance is measured from a maximum that forgets with this time constant.
FALL_MEMORY_S = 0.1
#: Log-conductance falls well below this are noise.
FALL_SCALE = 0.02


class CreepStates:
    """The memory of one or more sheets, advanced sample by sample.

    Parameters
    ----------
    sensors : int
        Sheets that are read at the same times.
    time_constants_s : sequence of float, length n_states
        Of the low-passed copies.

    Attributes
    ----------
    states : ndarray, shape (sensors, 1 + n_states)
        ln(excess + 0.1) and its low-passed copies.
    fall : ndarray, shape (sensors,)
        ln(1 + fall / 0.02), where the fall is that of log conductance from its recent maximum, less
        one digit of the readout: the sign of unloading, which conductance follows late.

    Examples
    --------
    >>> sheet = CreepStates(sensors=1, time_constants_s=(1.0,))
    >>> sheet.step(0.0, [0.9]); sheet.step(1.0, [9.9])
    >>> sheet.states.round(3).tolist()
    [[2.303, 1.456]]
    """

    def __init__(
        self, *, sensors: int = 1, time_constants_s: tuple[float, ...] = TIME_CONSTANTS_S
    ) -> None:
        self._tau_s = np.asarray(time_constants_s, dtype=float)
        self._time_s: float | None = None
        self._peak = np.zeros(sensors)
        self.states: FloatArray = np.zeros((sensors, 1 + len(self._tau_s)))
        self.fall: FloatArray = np.zeros(sensors)

    def step(self, time_s: float, excess: ArrayLike, *, resolution: ArrayLike = 0.0) -> None:
        """Take one reading per sheet.

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        excess : array_like, shape (sensors,)
            Excess conductance G/G0 - 1.
        resolution : array_like, shape (sensors,) or scalar
            Change of `excess` that one digit of the readout makes at this reading.

        Raises
        ------
        ValueError
            If time runs backwards.
        """
        above = np.maximum(np.asarray(excess, dtype=float), 0.0) + CONTACT_EXCESS
        log_now = np.log(above)
        if self._time_s is None:
            self.states = np.repeat(log_now[:, None], self.states.shape[1], axis=1)
            self._peak = log_now.copy()
        else:
            elapsed_s = time_s - self._time_s
            if elapsed_s < 0:
                raise ValueError(f"time runs backwards: {time_s} s after {self._time_s} s")
            share = -np.expm1(-elapsed_s / self._tau_s)
            self.states[:, 1:] += share * (log_now[:, None] - self.states[:, 1:])
            self.states[:, 0] = log_now
            forgotten = -np.expm1(-elapsed_s / FALL_MEMORY_S)
            self._peak = np.maximum(log_now, self._peak + forgotten * (log_now - self._peak))
        self._time_s = time_s
        fall = self._peak - log_now - np.asarray(resolution, dtype=float) / above
        self.fall = np.log1p(np.maximum(fall, 0.0) / FALL_SCALE)


def loading_sensitivity(time_s: FloatArray, log_excess: FloatArray) -> FloatArray:
    """Return how fast log conductance grows with the log of the time since contact, now.

    While a gripper closes at a steady speed the force grows about in proportion to the time since
    contact, so this is the sheet's own exponent at this force, seen without knowing any force.

    Parameters
    ----------
    time_s : ndarray, shape (n_times,)
        Up to now, seconds.
    log_excess : ndarray, shape (n_times, sensors)
        ln(excess + 0.1) of the same times.

    Returns
    -------
    ndarray, shape (sensors,)
        Within 0.1 to 4, which bounds what a noisy rise may claim.
    """
    now = log_excess[-1]
    rest = np.quantile(log_excess, 0.1, axis=0)
    untouched = log_excess < rest + 0.3 * (now - rest)
    last = len(time_s) - 1 - np.argmax(untouched[::-1], axis=0)
    contact_s = np.where(untouched.any(axis=0), time_s[last], time_s[0])
    recent = max(int(np.searchsorted(time_s, time_s[-1] - RATE_WINDOW_S)), 0)
    recent = min(recent, max(len(time_s) - 2, 0))
    window_s = max(float(time_s[-1] - time_s[recent]), 1e-3)
    rate = (now - log_excess[recent]) / window_s
    return np.asarray(np.clip(rate * (time_s[-1] - contact_s), 0.1, 4.0))


#: Stretch over which the present rate of rise is measured: a few frames of a 15 Hz readout would
#: be too long, one of a quantised one too short.
RATE_WINDOW_S = 0.12
