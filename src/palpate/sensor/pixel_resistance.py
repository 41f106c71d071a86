"""Conversion of a frame's counts to pixel resistances: divider, series resistance, crosstalk.

All other modules use this conversion, for rest values, loads and recordings.
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
    """Return the resistance of each pixel: inf if open or hidden, 0 if short.

    The result is NaN if no set of resistances explains the readings.

    `counts`, shape (..., rows, cols): readings, summed over `oversampling` conversions.
    `layout`: provides the divider, the series resistance and the state of idle lines.
    Raises `ValueError` if the counts do not fit the layout's pixels or converter.

    Without the correction, four equal pixels behind two multiplexers read a quarter too low:

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
    reading = resistance_ohm(counts, divider=layout.divider, oversampling=oversampling)
    # The noise of a short pixel can put its reading below the resistance of the lines.
    ohm = np.maximum(reading - layout.line_ohm, 0.0)
    if layout.idle_lines == "floating":
        return unmix_floating(ohm)
    if layout.idle_lines == "held":
        return unmix_held(ohm, reference_ohm=layout.divider.reference_ohm + layout.line_ohm)
    return ohm
