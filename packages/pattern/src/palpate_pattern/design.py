"""The design of a sensor: its dimensions in millimetres, and the named designs."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Cutter:
    """Tolerances of the cutter and of manual alignment.

    The cutting area is that of the Brother ScanNCut2 CM350 on its 12 inch mat (296 x 298 mm). The
    minimum feature, the minimum gap and the alignment error are conservative values for copper tape
    and Velostat on such a machine, not the manufacturer's figures.
    """

    width_mm: float = 296.0
    height_mm: float = 298.0
    feature_mm: float = 1.0
    gap_mm: float = 0.5
    alignment_mm: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorDesign:
    """One sensor, for one finger.

    >>> PRESETS["paper-3x2"].pitch_mm
    (10.0, 10.0)
    """

    #: Stem of the files.
    name: str
    #: Pixels along y and x, 1 to 16 each. Rows are copper on the base, columns on the cover.
    rows: int
    cols: int
    #: Size of a Velostat pixel.
    pixel_width_mm: float
    pixel_height_mm: float
    #: Gap between neighbouring pixels.
    gap_mm: float
    #: Radius of a pixel's corners: 0 for a rectangle, half of the size for a circle.
    corner_mm: float = 0.0
    #: Overlap of the Velostat around the crossing of two copper lines.
    overhang_mm: float = 1.0
    #: Width of the copper between pixels and pads.
    trace_mm: float = 1.2
    #: Solder pads at the end of the tail; a pitch of 2.54 mm fits pin headers and ribbon cables.
    pad_width_mm: float = 1.6
    pad_length_mm: float = 5.0
    pad_pitch_mm: float = 2.54
    #: Distance from the last pixels to the pads.
    tail_mm: float = 20.0
    #: Margin of base and cover around pixels and copper.
    margin_mm: float = 3.0
    #: Width of base and cover around the pixels, if the finger determines it; None for the minimum.
    substrate_width_mm: float | None = None

    @property
    def pitch_mm(self) -> tuple[float, float]:
        """Distance between the centres of neighbouring pixels, along x and y."""
        return self.pixel_width_mm + self.gap_mm, self.pixel_height_mm + self.gap_mm

    @property
    def bars_mm(self) -> tuple[float, float]:
        """Width of the column bars and height of the row bars, crossing in a pixel.

        The bars are as wide as the overhang permits. With rounded pixels, the overhang applies at
        the corners of the crossing.

        >>> PRESETS["paper-2x2"].bars_mm
        (5.0, 5.0)
        """
        inset = self.overhang_mm
        if self.corner_mm > self.overhang_mm:
            inset = self.corner_mm - (self.corner_mm - self.overhang_mm) / math.sqrt(2)
        return self.pixel_width_mm - 2 * inset, self.pixel_height_mm - 2 * inset


#: The paper states matrices and "larger" and "smaller" pixels (Figure 1c) but no dimensions. The
#: sizes here are chosen for the 10 mm pitch of `palpate.sensor.array`. `so101` has the 2 x 2
#: matrix of the paper and is as narrow as its traces permit, for small printed grippers.
PRESETS: dict[str, SensorDesign] = {
    "paper-2x2": SensorDesign(
        name="paper-2x2", rows=2, cols=2, pixel_width_mm=7.0, pixel_height_mm=7.0, gap_mm=3.0
    ),
    "paper-3x2": SensorDesign(
        name="paper-3x2", rows=3, cols=2, pixel_width_mm=9.0, pixel_height_mm=9.0, gap_mm=1.0
    ),
    "so101": SensorDesign(
        name="so101",
        rows=2,
        cols=2,
        pixel_width_mm=5.0,
        pixel_height_mm=7.0,
        gap_mm=1.0,
        trace_mm=1.0,
        margin_mm=1.5,
        tail_mm=30.0,
    ),
}
