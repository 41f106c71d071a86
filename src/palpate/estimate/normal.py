"""The normal density, without the distributions of `scipy.stats`: they take longer to load."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray


def normal_density(x: ArrayLike, mean: float, sd: float) -> FloatArray:
    """Return the density at `x`, of any shape.

    >>> normal_density([0.0, 1.0], 0.0, 1.0).round(4).tolist()
    [0.3989, 0.242]
    """
    z = (np.asarray(x, dtype=float) - mean) / sd
    return np.asarray(np.exp(-(z**2) / 2.0) / math.sqrt(2.0 * math.pi) / sd)
