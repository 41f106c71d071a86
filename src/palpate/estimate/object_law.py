"""What every stiffness takes for granted of an object and of the hand: the priors, in one place."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Exponents of force over indentation and how common they are: 1 a flat or layered body, 1.5 a
#: round one (Hertz), 1.25 what is between, 2 pointed or stiffening.
SHAPES = {1.0: 0.4, 1.25: 0.15, 1.5: 0.35, 2.0: 0.1}
#: Nothing softer is an object, and nothing stiffer can be told from rigid by such a gripper, N/mm.
SOFTEST_N_PER_MM, STIFFEST_N_PER_MM = 0.02, 500.0
#: An object off the middle, or another face than the block's: pads and fingers give a share more.
GIVE_SD = 0.02
#: A width is never known better, mm (half an encoder step of the usual servo).
SHARPEST_MM = 0.02


def weighted_quantiles(
    values: FloatArray, weight: FloatArray, at: Sequence[float]
) -> tuple[float, ...]:
    """Return quantiles of weighted values, linear between them.

    Parameters
    ----------
    values, weight : ndarray, shape (n,)
        Weights need not sum to 1.
    at : sequence of float
        Shares of the weight below each quantile.

    Examples
    --------
    >>> weighted_quantiles(np.array([3.0, 1.0, 2.0]), np.array([1.0, 1.0, 1.0]), [0.5])
    (2.0,)
    """
    order = np.argsort(values)
    reached = np.cumsum(weight[order]) - 0.5 * weight[order]
    return tuple(np.interp(at, reached / weight.sum(), values[order]).tolist())
