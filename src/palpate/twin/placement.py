"""Positions of the pixels on the fingers, and random variation of placements and contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.sensor.array import ArrayLayout
from palpate.twin.ranges import Ranges, draw_uniform
from palpate.twin.velostat import Creep, Environment, Sheet

#: Offset of an object in a fixture from the centre, as a fraction of the pixel pitch.
_FIXTURE_OFF_CENTRE = 0.1


@dataclass(frozen=True, slots=True)
class Placement:
    """Variation between grasps: position, gains, creep, width error, lead of the first finger."""

    off_centre_mm: tuple[float, float]
    gain: FloatArray
    creep: Creep
    width_error_mm: float
    lead_mm: float
    first_finger: int


class Placements:
    """Reproducible random placements of one session.

    `sheet`, `grid`: the touched sheet and its pixels.
    `ranges`: ranges of the variation between grasps.
    `seed`: seed of the variation.
    """

    def __init__(self, *, sheet: Sheet, grid: PixelGrid, ranges: Ranges, seed: int) -> None:
        self._sheet, self._grid, self._ranges, self._seed = sheet, grid, ranges, seed
        #: Return the placement of the n-th object and contact in an environment.
        self.of = lru_cache(maxsize=64)(self._draw_placement)
        #: Numbers of the objects in a fixture.
        self.fixtures: set[int] = set()

    def _draw_placement(self, placed: int, contacts: int, environment: Environment) -> Placement:
        ranges, pixels = self._ranges, self._sheet.gain.size
        where = np.random.default_rng([self._seed, 1, placed]).uniform(-1, 1, 2)
        rng = np.random.default_rng([self._seed, 2, placed, contacts])
        fraction = _FIXTURE_OFF_CENTRE if placed in self.fixtures else ranges.off_centre
        spot = fraction * self._grid.pitch_mm * (where + 0.05 * rng.standard_normal(2))
        common = ranges.place_common_log_sd * rng.standard_normal()
        own = ranges.place_pixel_log_sd * rng.standard_normal(pixels)
        since = 0 if environment.cycles_are_all else contacts
        used = replace(environment, cycles=environment.cycles + since)
        gain = self._sheet.gain * self._sheet.gain_factor(used) * np.exp(common + own)
        aside = np.random.default_rng([self._seed, 3, placed])
        off_middle_mm = (
            0.0 if placed in self.fixtures else draw_uniform(aside, ranges.off_middle_mm)
        )
        return Placement(
            off_centre_mm=(float(spot[0]), float(spot[1])),
            gain=gain,
            creep=self._sheet.family.draw(rng),
            width_error_mm=ranges.width_repeat_sd_mm * float(rng.standard_normal()),
            lead_mm=2.0 * off_middle_mm,
            first_finger=int(aside.integers(2)),
        )


@dataclass(frozen=True, slots=True)
class PixelGrid:
    """Positions of the pixels relative to the centre of their finger, mm, flattened."""

    along_mm: NDArray[np.float64]
    across_mm: NDArray[np.float64]
    finger: NDArray[np.int64]
    pitch_mm: float

    @classmethod
    def from_layout(cls, layout: ArrayLayout) -> PixelGrid:
        """Build the grid of a layout; the rows of a finger run along it."""
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
