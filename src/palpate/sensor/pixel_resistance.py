"""Conversion of a frame's counts to pixel resistances, and of these to excess conductance.

All other modules use these conversions, for rest values, loads, forces and recordings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.signal.circuit import resistance_ohm
from palpate.signal.crosstalk import unmix_floating, unmix_held
from palpate.signal.relative import excess_conductance


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


#: A pixel whose rest value is this many steps of the converter above zero is never open.
_REST_STEPS = 5


class PixelExcess(NamedTuple):
    """Excess conductance of the pixels, never infinite.

    Attributes
    ----------
    excess : ndarray, shape (..., rows, cols)
        A saturated pixel has that of the converter's last step, which is a lower bound; NaN without
        a reading or a rest value.
    saturated, open : ndarray of bool, shape (..., rows, cols)
        Pixels with a rest value whose conductance is beyond the converter's last step, and pixels
        with a rest value without a reading.
    lost : ndarray of bool, shape (..., rows, cols)
        Pixels without a reading that have one at rest: a broken line, not a weak contact. Their
        load is unknown.
    """

    excess: FloatArray
    saturated: NDArray[np.bool_]
    open: NDArray[np.bool_]
    lost: NDArray[np.bool_]

    @property
    def has_lost(self) -> bool:
        """Whether any pixel has lost its reading; a force is then a lower bound."""
        return bool(self.lost.any())

    @property
    def has_saturated(self) -> bool:
        """Whether any pixel is saturated; a force is then a lower bound."""
        return bool(self.saturated.any())


def pixel_excess(ohm: ArrayLike, *, rest_ohm: ArrayLike, layout: ArrayLayout) -> PixelExcess:
    """Return the excess conductance of pixels, with masks of saturated and open pixels.

    `ohm`, shape (..., rows, cols): output of `pixel_resistance_ohm`.
    `rest_ohm`, shape (rows, cols): rest values.
    `layout`: its divider has the converter's last step.

    >>> from palpate.sensor.array import ArrayLayout
    >>> pad = ArrayLayout(name="pad", rows=1, cols=3, finger_of_row=(0,))
    >>> found = pixel_excess([[500.0, 0.0, np.inf]], rest_ohm=[[1e3, 1e3, 1e3]], layout=pad)
    >>> found.excess.round().tolist(), found.saturated.tolist(), found.open.tolist()
    ([[1.0, 144.0, nan]], [[False, True, False]], [[False, False, True]])
    """
    read = np.asarray(ohm, dtype=float)
    least_ohm = layout.divider.least_ohm
    rest = np.asarray(rest_ohm, dtype=float)
    known = rest > 0
    is_open = known & ~np.isfinite(read)
    return PixelExcess(
        excess=excess_conductance(np.maximum(read, least_ohm), rest_ohm=rest_ohm),
        saturated=known & (read <= least_ohm),
        open=is_open,
        lost=is_open & (np.isnan(read) | (rest * _REST_STEPS < layout.divider.most_ohm)),
    )
