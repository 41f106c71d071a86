"""Where the pixels of a layout are on their fingers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.sensor.array import ArrayLayout


@dataclass(frozen=True, slots=True)
class PixelGrid:
    """Where the pixels are on their fingers: millimetres from the finger's centre, flattened."""

    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    finger: NDArray[np.int64]
    pitch_mm: float

    @classmethod
    def of(cls, layout: ArrayLayout) -> PixelGrid:
        """Build the grid of a layout: the rows of a finger run along it."""
        finger_of_row = np.array(layout.finger_of_row)
        along = np.empty(layout.rows)
        for finger in np.unique(finger_of_row):
            rows = np.flatnonzero(finger_of_row == finger)
            along[rows] = (np.arange(rows.size) - (rows.size - 1) / 2) * layout.pitch_mm
        across = (np.arange(layout.cols) - (layout.cols - 1) / 2) * layout.pitch_mm
        return cls(
            np.repeat(along, layout.cols),
            np.tile(across, layout.rows),
            np.repeat(np.unique(finger_of_row, return_inverse=True)[1], layout.cols),
            layout.pitch_mm,
        )
