"""Conversion of a frame's counts to pixel resistances: divider, series resistance, crosstalk.

The only module that does this conversion. All uses of pixels take them from here, so that rest
values, loads and recordings are always solved alike.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.signal.circuit import resistance_ohm
from palpate.signal.crosstalk import unmix_floating, unmix_held


def pixel_resistance_ohm(
    counts: ArrayLike, *, layout: ArrayLayout, oversampling: int = 1
) -> FloatArray:
    """Return the resistance of each pixel: inf where open or hidden, 0 where short.

    NaN where no resistances explain the readings.

    `counts`, shape (..., rows, cols): readings, summed over `oversampling` conversions.
    `layout`: divider, resistance in series, and what idle lines do.
    Raises `ValueError` if counts don't fit the layout's pixels or converter.

    Four equal pixels behind two bare multiplexers read a quarter low:

    >>> from palpate.sensor.array import ArrayLayout
    >>> bare = ArrayLayout(name="bare", rows=2, cols=2, finger_of_row=(0, 0), idle_lines="floating")
    >>> counts = [[582, 582], [582, 582]]
    >>> resistance_ohm(counts, divider=bare.divider)[0, 0].round().item()
    3569.0
    >>> pixel_resistance_ohm(counts, layout=bare)[0, 0].round().item()
    4759.0
    """
    counts = np.asarray(counts)
    if counts.shape[-2:] != (layout.rows, layout.cols):
        raise ValueError(
            f"counts of shape {counts.shape} are not frames of layout {layout.name} "
            f"({layout.rows} x {layout.cols})"
        )
    read = resistance_ohm(counts, divider=layout.divider, oversampling=oversampling)
    # A short behind the lines reads less than they have by the noise alone.
    ohm = np.maximum(read - layout.line_ohm, 0.0)
    if layout.idle_lines == "floating":
        return unmix_floating(ohm)
    if layout.idle_lines == "held":
        return unmix_held(ohm, reference_ohm=layout.divider.reference_ohm + layout.line_ohm)
    return ohm
