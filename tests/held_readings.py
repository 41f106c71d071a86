"""What a matrix whose idle rows are held at a rail reads: what `unmix_held` undoes."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray


def held_readings_ohm(resistance_ohm: ArrayLike, *, reference_ohm: float) -> FloatArray:
    """Return what the divider's formula makes of each reading, shape as given.

    The selected column is the divider's node; the other pixels of that column lie in parallel with
    the reference resistor. Idle columns make no difference.
    """
    conductance = 1.0 / np.asarray(resistance_ohm, dtype=float)
    column = conductance.sum(axis=-2, keepdims=True)
    loading = 1.0 + reference_ohm * (column - conductance)
    with np.errstate(divide="ignore"):
        return np.asarray(loading / conductance)
