"""Layout of a design as five stacked layers with alignment marks.

All coordinates are those of the finished sensor seen from its cover. Row copper leaves the pixels
on the left and runs down in lanes. Column copper runs straight down and is gathered next to the
lanes. Row and column copper cross only in pixels. The row pads are on the base, where the cover is
shorter; the column pads are on the cover, where the base is shorter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

from palpate_pattern.design import SensorDesign
from palpate_pattern.shapes import (
    Outline,
    PointMm,
    Rect,
    Stroke,
    circle,
    round_corners,
    round_rect,
)

MARK_MM = 3.0
#: Border around the sensor on every sheet; the marks are in the middle of the border.
BORDER_MM = 8.0
#: Radius of tape corners; sharp corners lift and tear.
TAPE_CORNER_MM = 1.0


@dataclass(frozen=True, slots=True)
class Layer:
    """One sheet of material and its cuts."""

    #: Name for files and users.
    name: str
    material: str
    #: Cutting lines as seen from the cover of the finished sensor.
    parts: tuple[Outline, ...]
    #: Orientation of the sheet on the cutter.
    why: str
    #: Whether the file is mirrored because the sheet is cut from the other side.
    mirrored: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Pixel:
    """A Velostat pixel and its contact area between row and column copper."""

    row: int
    col: int
    body: Rect
    contact: Rect


@dataclass(frozen=True, slots=True, kw_only=True)
class Pattern:
    """A sensor laid out on its sheet, mm."""

    design: SensorDesign
    #: Size of the sheet.
    width: float
    height: float
    #: One piece of copper per row and column.
    rows: tuple[Stroke, ...]
    cols: tuple[Stroke, ...]
    #: Row by row.
    pixels: tuple[Pixel, ...]
    #: Base and cover around the pixels, without the tail.
    body: Rect
    #: Corners of base and cover.
    base: tuple[PointMm, ...]
    cover: tuple[PointMm, ...]
    #: Centres of the registration marks, equal in every layer. They are symmetric about the
    #: vertical centre line of the sheet and therefore invariant to mirroring.
    marks: tuple[PointMm, ...]
    #: Minimum length of the tail for the routing.
    needed_tail_mm: float

    @property
    def mark_outlines(self) -> tuple[Outline, ...]:
        """The marks as cutting lines."""
        return tuple(circle(mark, diameter=MARK_MM) for mark in self.marks)

    def layers(self) -> tuple[Layer, ...]:
        """Return the five layers from the base up."""
        corner = self.design.corner_mm
        pixels = tuple(round_rect(pixel.body, radius=corner) for pixel in self.pixels)
        rows, cols = (tuple(net.outline() for net in nets) for nets in (self.rows, self.cols))
        return (
            Layer(
                "1-base",
                "base tape",
                (_tape(self.base),),
                "cut with the liner down and the back up; in the sensor the adhesive faces up",
                mirrored=True,
            ),
            Layer(
                "2-copper-rows",
                "copper tape",
                rows,
                "cut with the liner down and bare copper up, as in the sensor",
            ),
            Layer("3-velostat", "Velostat", pixels, "both sides are alike"),
            Layer(
                "4-copper-columns",
                "copper tape",
                cols,
                "cut with bare copper up; in the sensor bare copper faces down",
                mirrored=True,
            ),
            Layer(
                "5-cover",
                "cover tape",
                (_tape(self.cover),),
                "cut with the liner down and the back up, as in the sensor",
            ),
        )


def lay_out(design: SensorDesign) -> Pattern:
    """Place every shape of a design; `palpate_pattern.refusals` checks the result.

    >>> from palpate_pattern.design import PRESETS
    >>> pattern = lay_out(PRESETS["paper-2x2"])
    >>> len(pattern.pixels), [layer.name for layer in pattern.layers() if layer.mirrored]
    (4, ['1-base', '4-copper-columns'])
    """
    # The lanes are left of the pixels; the lane of the first row is outermost.
    lane_x = [-design.pad_pitch_mm * (design.rows - r - 0.5) for r in range(design.rows)]
    half_copper = max(design.trace_mm, design.pad_width_mm) / 2
    left_mm = BORDER_MM + design.margin_mm + half_copper - lane_x[0]
    active = Rect(
        left=left_mm,
        top=BORDER_MM + design.margin_mm,
        right=left_mm + design.cols * design.pitch_mm[0] - design.gap_mm,
        bottom=BORDER_MM + design.margin_mm + design.rows * design.pitch_mm[1] - design.gap_mm,
    )
    lanes = [active.left + x for x in lane_x]
    pixels = _pixels(design, active=active)
    column_x = [pixels[c].body.centre[0] for c in range(design.cols)]
    first_pad = lanes[-1] + 1.5 * design.pad_pitch_mm
    if design.pitch_mm[0] > design.pad_pitch_mm:
        first_pad = max(first_pad, column_x[0])
    column_pads = [first_pad + c * design.pad_pitch_mm for c in range(design.cols)]
    levels = _jog_levels(column_x, column_pads)
    jogs_mm = design.pad_pitch_mm * (max(levels) + 1)
    pads = Rect(
        left=lanes[0] - half_copper,
        top=active.bottom + design.tail_mm,
        right=column_pads[-1] + half_copper,
        bottom=active.bottom + design.tail_mm + design.pad_length_mm,
    )
    body = Rect(
        left=BORDER_MM,
        top=BORDER_MM,
        # Columns that spread to wider pads turn next to the pixels and need tape there.
        right=BORDER_MM + design.substrate_width_mm
        if design.substrate_width_mm is not None
        else max(active.right, pads.right) + design.margin_mm,
        bottom=active.bottom + jogs_mm + design.margin_mm,
    )
    split = (lanes[-1] + column_pads[0]) / 2
    base, cover = _tapes(body, pads=pads, split=split, margin=design.margin_mm)
    width = max(x for x, _ in (*base, *cover)) + BORDER_MM
    height = max(y for _, y in (*base, *cover)) + BORDER_MM
    inset = BORDER_MM / 2
    return Pattern(
        design=design,
        width=width,
        height=height,
        rows=_row_copper(design, active=active, lanes=lanes, pads=pads),
        cols=_column_copper(
            design, active=active, xs=column_x, pad_xs=column_pads, levels=levels, pads=pads
        ),
        pixels=pixels,
        body=body,
        base=base,
        cover=cover,
        marks=((inset, inset), (width - inset, inset), (width / 2, height - inset)),
        needed_tail_mm=jogs_mm + design.margin_mm + 2 * TAPE_CORNER_MM,
    )


def _tape(corners: Sequence[PointMm]) -> Outline:
    shortest = min(math.dist(a, b) for a, b in pairwise((*corners, corners[0])))
    return round_corners(corners, radius=min(TAPE_CORNER_MM, shortest / 2))


def _pixels(design: SensorDesign, *, active: Rect) -> tuple[Pixel, ...]:
    bar_width, bar_height = design.bars_mm
    width, height = design.pixel_width_mm, design.pixel_height_mm
    found = []
    for row, col in product(range(design.rows), range(design.cols)):
        centre = (
            active.left + width / 2 + col * design.pitch_mm[0],
            active.top + height / 2 + row * design.pitch_mm[1],
        )
        body = Rect.from_centre(centre, width=width, height=height)
        contact = Rect.from_centre(centre, width=bar_width, height=bar_height)
        found.append(Pixel(row=row, col=col, body=body, contact=contact))
    return tuple(found)


def _row_copper(
    design: SensorDesign, *, active: Rect, lanes: Sequence[float], pads: Rect
) -> tuple[Stroke, ...]:
    _, bar = design.bars_mm
    first = active.top + design.pixel_height_mm / 2
    return tuple(
        Stroke.from_points(
            [(active.right, y), (active.left, y), (x, y), (x, pads.top), (x, pads.bottom)],
            widths=[bar, design.trace_mm, design.trace_mm, design.pad_width_mm],
        )
        for x, y in zip(
            lanes, (first + r * design.pitch_mm[1] for r in range(design.rows)), strict=True
        )
    )


def _column_copper(
    design: SensorDesign,
    *,
    active: Rect,
    xs: Sequence[float],
    pad_xs: Sequence[float],
    levels: Sequence[int],
    pads: Rect,
) -> tuple[Stroke, ...]:
    bar, _ = design.bars_mm
    strokes = []
    for x, pad_x, level in zip(xs, pad_xs, levels, strict=True):
        turn = active.bottom + design.pad_pitch_mm * (level + 0.5)
        strokes.append(
            Stroke.from_points(
                [
                    *((x, y) for y in (active.top, active.bottom, turn)),
                    *((pad_x, y) for y in (turn, pads.top, pads.bottom)),
                ],
                widths=[bar, *[design.trace_mm] * 3, design.pad_width_mm],
            )
        )
    return tuple(strokes)


def _jog_levels(xs: Sequence[float], pad_xs: Sequence[float]) -> list[int]:
    """Return the level at which each column turns towards its pad without crossings.

    A column to the left turns below the columns further left; a column to the right turns below
    the columns further right. The two groups never cross.
    """
    levels = [0] * len(xs)
    leftward = [c for c in range(len(xs)) if pad_xs[c] < xs[c] - 1e-9]
    rightward = [c for c in reversed(range(len(xs))) if pad_xs[c] > xs[c] + 1e-9]
    for group in (leftward, rightward):
        for level, column in enumerate(group):
            levels[column] = level
    return levels


def _tapes(
    body: Rect, *, pads: Rect, split: float, margin: float
) -> tuple[tuple[PointMm, ...], tuple[PointMm, ...]]:
    """Return the corners of base and cover, which differ at the end of the tail."""
    right, end = pads.right + margin, pads.bottom + margin
    shoulder: list[PointMm] = [(body.right, body.bottom), (right, body.bottom)]
    if body.right - right < 2 * TAPE_CORNER_MM:
        # The step is too small for rounded corners, so the tail is as wide as the body.
        right, shoulder = max(right, body.right), []
    top: list[PointMm] = [
        (body.left, body.top),
        (body.right if shoulder else right, body.top),
        *shoulder,
    ]
    base = (*top, (right, pads.top), (split, pads.top), (split, end), (body.left, end))
    cover = (*top, (right, end), (split, end), (split, pads.top), (body.left, pads.top))
    return base, cover
