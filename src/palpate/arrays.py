"""Type alias for arrays of measurements, and the replacement of their missing values."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]


def replace_non_finite(values: FloatArray) -> FloatArray:
    """Return `numpy.nan_to_num` of values of any shape, several times as fast for finite ones.

    >>> replace_non_finite(np.array([1.0, np.nan])).tolist()
    [1.0, 0.0]
    """
    return values if np.isfinite(values).all() else np.nan_to_num(values)
