"""The frames of the early reading of a weight, in a recording of its placement."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.force.creep_update import EARLY_S

#: A weight is placed after the last frame below this fraction of its settled reading.
_UNLOADED_FRACTION = 0.1
#: Averaging time of the early reading, and largest gap between frames as the weight is placed.
_MEAN_S = 0.5
#: Largest early reading over the settled one: by as much a settled reading may still change.
_MOST_OVER = 1.03


def find_early(time_s: FloatArray, total: FloatArray, *, settled: float) -> NDArray[np.bool_]:
    """Return which frames are the early reading of a weight; none if they do not show it.

    Creep raises the reading. A larger one than the settled one is that of a hand on the weight.

    `time_s`, `total`, shape (frames,): times and summed excess up to the settled reading; NaN if a
        frame is unusable.
    `settled`: summed excess of the settled reading.

    >>> time_s = 0.5 * np.arange(8.0)
    >>> find_early(time_s, np.array([0.0, 0, 3, 3.2, 3.3, 3.4, 3.5, 3.6]), settled=4.0).nonzero()
    (array([5]),)
    >>> bool(find_early(time_s, np.full(8, 3.5), settled=4.0).any())
    False
    """
    unloaded = np.flatnonzero(total[:-1] < _UNLOADED_FRACTION * settled)
    if not unloaded.size or np.diff(time_s)[unloaded[-1]] > _MEAN_S:
        return np.zeros(total.size, dtype=bool)
    until_s = time_s[unloaded[-1]] + EARLY_S
    chosen = np.isfinite(total) & (time_s > until_s - _MEAN_S) & (time_s <= until_s)
    return np.asarray(chosen & (total[chosen].sum() < _MOST_OVER * settled * chosen.sum()))
