"""Centre of the pressure on each finger."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout


def pressure_centres_mm(excess: FloatArray, layout: ArrayLayout) -> tuple[float, ...]:
    """Return the centre of each finger's readings: along its rows, then along the columns.

    c = sum(x_i g_i) / sum(g_i), with the position x_i and the excess conductance g_i of pixel i,
    relative to the middle of the finger. A pixel without a reading, or with less than at rest,
    counts as unloaded; a finger without load has its centre at 0.

    `excess`, shape (rows, cols): conductance relative to rest, minus 1.

    >>> pad = ArrayLayout(name="pad", rows=2, cols=2, finger_of_row=(0, 0), pitch_mm=10.0)
    >>> pressure_centres_mm(np.array([[1.0, 1.0], [3.0, 3.0]]), pad)
    (2.5, 0.0)
    """
    load = np.maximum(np.nan_to_num(excess), 0.0)
    finger_of_row = np.array(layout.finger_of_row)
    centres = list[float]()
    for finger in range(layout.fingers):
        part = load[finger_of_row == finger]
        total = max(float(part.sum()), np.finfo(float).tiny)
        for axis, count in enumerate(part.shape):
            place_mm = (np.arange(count) - (count - 1) / 2) * layout.pitch_mm
            centres.append(float(part.sum(axis=1 - axis) @ place_mm) / total)
    return tuple(centres)
