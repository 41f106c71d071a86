"""Centre of the pressure on each finger."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.sensor.array import ArrayLayout
from palpate.sensor.sample import Sample

#: Standard deviation of a value rounded to whole steps.
_ROUNDING_SD = 12.0**-0.5


@dataclass(frozen=True, slots=True)
class PressureCentres:
    """Pressure centre of each finger: along its rows, then along the columns.

    Attributes
    ----------
    place_mm : tuple of float
        Centres relative to the middle of the finger.
    rounding_mm : tuple of float
        Standard deviation of each centre due to the steps of the converter.
    """

    place_mm: tuple[float, ...]
    rounding_mm: tuple[float, ...]


def pressure_centres(sample: Sample, layout: ArrayLayout) -> PressureCentres:
    """Return the centre of the readings of each finger.

    c = sum(x_i g_i) / sum(g_i), with the position x_i and the excess conductance g_i of pixel i. A
    pixel without a reading, or with less than at rest, counts as unloaded. One step of a converter
    with N steps changes g_i by (1 + g_i) (R_i + R_ref)^2 / (N R_i R_ref), in either leg of the
    divider, and the centre by (x_i - c) / sum(g_i) times that.

    >>> from palpate.sensor.array import Frame
    >>> from palpate.sensor.sample import SampleReader
    >>> pad = ArrayLayout(name="pad", rows=2, cols=1, finger_of_row=(0, 0), pitch_mm=10.0)
    >>> reader = SampleReader(pad, rest_ohm=[[9400.0], [9400.0]])
    >>> sample = reader.read(Frame(time_s=0.0, sequence=0, counts=[[512], [768]]))
    >>> found = pressure_centres(sample, pad)
    >>> [round(value, 3) for value in (*found.place_mm, *found.rounding_mm)]
    [3.333, 0.0, 0.004, 0.0]
    """
    load = np.maximum(np.nan_to_num(sample.excess), 0.0)
    reference_ohm, steps = layout.divider.reference_ohm, layout.divider.full_scale
    readable = np.isfinite(sample.excess) & (sample.resistance_ohm > 0)
    ohm = np.where(readable, sample.resistance_ohm, reference_ohm)
    step = np.where(
        readable, (1.0 + load) * (ohm + reference_ohm) ** 2 / (steps * ohm * reference_ohm), 0.0
    )
    finger_of_row = np.array(layout.finger_of_row)
    places, roundings = list[float](), list[float]()
    for finger in range(layout.fingers):
        rows = finger_of_row == finger
        total = max(float(load[rows].sum()), 1e-9)
        for axis, count in enumerate(load[rows].shape):
            position = (np.arange(count) - (count - 1) / 2) * layout.pitch_mm
            position = position[:, None] if axis == 0 else position[None, :]
            centre = float((load[rows] * position).sum()) / total
            moved = (position - centre) * step[rows] / total
            places.append(centre)
            roundings.append(_ROUNDING_SD * float(np.sqrt((moved**2).sum())))
    return PressureCentres(tuple(places), tuple(roundings))
