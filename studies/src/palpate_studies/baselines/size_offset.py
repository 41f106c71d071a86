"""The previous width of the paper's Figure 13 plus one constant: all of its bias taken out.

The constant is the mean error on other sensors: ten fruits sized with a caliper give it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate_studies.protocol.parts import Learned


def without_bias(error_mm: FloatArray, sensors: Sequence[int]) -> FloatArray:
    """Return errors less the mean error on the other sensors, shape (n,); NaN with no other.

    Parameters
    ----------
    error_mm : ndarray, shape (n,)
        Errors of the previous width.
    sensors : sequence of int, length n
        Sensor of each.

    Examples
    --------
    >>> without_bias(np.array([-1.0, -1.2, -0.8]), [1, 2, 3]).round(2).tolist()
    [0.0, -0.3, 0.3]
    """
    of = np.array(sensors)
    found = np.full(error_mm.shape, np.nan)
    for sensor in set(sensors):
        others = of != sensor
        if others.any():
            bias = Learned(
                found=float(error_mm[others].mean()), seen=frozenset(map(str, of[others]))
            )
            found[~others] = error_mm[~others] - bias.on([str(sensor)])
    return found
