"""Checks of designs and patterns; errors state the reason and the amount."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import fields
from itertools import combinations, product

from palpate.errors import InputError
from palpate_pattern.design import Cutter, SensorDesign
from palpate_pattern.pattern import Pattern, Pixel
from palpate_pattern.shapes import Rect, Stroke

#: Rounding tolerance: a gap of exactly the minimum is accepted.
_TINY_MM = 1e-6


def check_design(design: SensorDesign, *, cutter: Cutter) -> None:
    """Check the dimensions of a design.

    Raises `InputError` for the first invalid dimension.
    """
    if not (1 <= design.rows <= 16 and 1 <= design.cols <= 16):
        raise InputError(
            f"{design.rows} x {design.cols} pixels: rows and columns must be 1 to 16 each, "
            "because a multiplexer has 16 channels"
        )
    for owner in (design, cutter):
        for part in fields(owner):
            value = getattr(owner, part.name)
            zero_is_fine = part.name in ("corner_mm", "overhang_mm", "gap_mm", "margin_mm")
            if isinstance(value, float) and (
                not math.isfinite(value) or value < 0 or (value == 0 and not zero_is_fine)
            ):
                what = part.name.removesuffix("_mm").replace("_", " ")
                raise InputError(f"{what} of {value:g} mm: must be a positive length")
    largest = min(design.pixel_width_mm, design.pixel_height_mm) / 2
    if design.corner_mm > largest + _TINY_MM:
        raise InputError(
            f"corner radius {design.corner_mm:g} mm is {design.corner_mm - largest:.2f} mm more "
            f"than half of the pixel ({largest:g} mm)"
        )
    for what, size_mm in (
        ("pixel width", design.pixel_width_mm),
        ("pixel height", design.pixel_height_mm),
        ("column copper in the pixels", design.bars_mm[0]),
        ("row copper in the pixels", design.bars_mm[1]),
        ("trace width", design.trace_mm),
        ("pad width", design.pad_width_mm),
        ("pad length", design.pad_length_mm),
    ):
        shortfall_mm = cutter.feature_mm - size_mm
        if shortfall_mm > _TINY_MM:
            raise InputError(
                f"{what} {size_mm:.2f} mm is {shortfall_mm:.2f} mm less than the smallest feature "
                f"of the cutter ({cutter.feature_mm:g} mm); enlarge it, or enlarge the pixel"
            )


def check_pattern(pattern: Pattern, *, cutter: Cutter) -> None:
    """Check a pattern for shorts, features that can't be cut, and parts outside the tape.

    Raises `InputError` with the first problem and the number of other problems.
    """
    problems = list(_find_problems(pattern, cutter=cutter))
    if problems:
        more = f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""
        raise InputError(f"this sensor can't work: {problems[0]}{more}")


def _find_problems(pattern: Pattern, *, cutter: Cutter) -> Iterator[str]:
    yield from _check_tail(pattern)
    yield from _check_edges(pattern, cutter=cutter)
    yield from _check_pixel_gaps(pattern, cutter=cutter)
    yield from _check_layers(pattern.rows, letter="R", cutter=cutter)
    yield from _check_layers(pattern.cols, letter="C", cutter=cutter)
    yield from _check_folds(pattern.design, cutter=cutter)
    yield from _check_crossings(pattern, cutter=cutter)
    yield from _check_leaks(pattern, cutter=cutter)
    for side, size_mm, most_mm in (
        ("wide", pattern.width, cutter.width_mm),
        ("high", pattern.height, cutter.height_mm),
    ):
        if size_mm > most_mm:
            yield (
                f"the drawing is {size_mm:.1f} mm {side}, {size_mm - most_mm:.1f} mm more than the "
                f"cutter's {most_mm:g} mm"
            )


def _check_tail(pattern: Pattern) -> Iterator[str]:
    missing_mm = pattern.needed_tail_mm - pattern.design.tail_mm
    if missing_mm > _TINY_MM:
        yield (
            f"tail of {pattern.design.tail_mm:g} mm is {missing_mm:.2f} mm too short for the "
            f"traces of {pattern.design.cols} columns; make it {pattern.needed_tail_mm:.2f} mm"
        )


def _check_edges(pattern: Pattern, *, cutter: Cutter) -> Iterator[str]:
    shortfall_mm = cutter.gap_mm - pattern.design.margin_mm
    if shortfall_mm > _TINY_MM:
        yield (
            f"margin of {pattern.design.margin_mm:g} mm is {shortfall_mm:.2f} mm less than the "
            "smallest distance of copper and pixels from the edge of the tape "
            f"({cutter.gap_mm:g} mm)"
        )
        return
    for pixel in pattern.pixels:
        excess_mm = pixel.body.right + cutter.gap_mm - pattern.body.right
        if excess_mm > _TINY_MM:
            yield (
                f"pixel {_name(pixel)} extends {excess_mm:.2f} mm too far to the right: base and "
                f"cover are {pattern.body.width:g} mm wide, and {cutter.gap_mm:g} mm of tape must "
                "remain at the edge"
            )
    wanted_mm = pattern.design.substrate_width_mm
    if wanted_mm is not None:
        excess_mm = max(x for x, _ in pattern.base) - pattern.body.left - wanted_mm
        if excess_mm > _TINY_MM:
            yield f"the tail is {excess_mm:.2f} mm wider than base and cover ({wanted_mm:g} mm)"


def _check_pixel_gaps(pattern: Pattern, *, cutter: Cutter) -> Iterator[str]:
    for one, two in combinations(pattern.pixels, 2):
        shortfall_mm = cutter.gap_mm - one.body.distance(two.body)
        if shortfall_mm > _TINY_MM:
            yield (
                f"pixels {_name(one)} and {_name(two)} are {one.body.distance(two.body):.2f} mm "
                f"apart, {shortfall_mm:.2f} mm less than the smallest gap ({cutter.gap_mm:g} mm)"
            )


def _check_layers(nets: Sequence[Stroke], *, letter: str, cutter: Cutter) -> Iterator[str]:
    covered = [net.rects() for net in nets]
    for (i, one), (k, two) in combinations(enumerate(covered), 2):
        gap_mm = min(a.distance(b) for a in one for b in two)
        if cutter.gap_mm - gap_mm > _TINY_MM:
            what = "are shorted" if gap_mm < _TINY_MM else f"are {gap_mm:.2f} mm apart"
            yield (
                f"traces of {letter}{i} and {letter}{k} {what}, {cutter.gap_mm - gap_mm:.2f} mm "
                f"less than the smallest gap ({cutter.gap_mm:g} mm); increase the pad pitch, or "
                "narrow the traces and pads"
            )


def _check_folds(design: SensorDesign, *, cutter: Cutter) -> Iterator[str]:
    """Yield a problem if the turns are so close that a trace would touch itself."""
    gap_mm = design.pad_pitch_mm - design.trace_mm
    if cutter.gap_mm - gap_mm > _TINY_MM:
        yield (
            f"traces of {design.trace_mm:g} mm at a pad pitch of {design.pad_pitch_mm:g} mm leave "
            f"a gap of {max(gap_mm, 0.0):.2f} mm at the turns, "
            f"{cutter.gap_mm - gap_mm:.2f} mm less than the smallest gap ({cutter.gap_mm:g} mm)"
        )


def _check_crossings(pattern: Pattern, *, cutter: Cutter) -> Iterator[str]:
    """Yield problems of row and column copper without sufficient Velostat in between.

    Copper next to a crossing also needs a distance, because the layers are aligned by hand.
    """
    for pixel in pattern.pixels:
        legs = product(pattern.rows[pixel.row].rects(), pattern.cols[pixel.col].rects())
        spare_mm = min(
            a.distance(b)
            if (crossing := a.intersection(b)) is None
            else _coverage_mm(crossing, pixel=pixel.body, corner_mm=pattern.design.corner_mm)
            for a, b in legs
        )
        if cutter.alignment_mm - spare_mm > _TINY_MM:
            yield (
                f"{_name(pixel).replace(' ', ' and ')} are {spare_mm:.2f} mm from a short next to "
                f"their pixel, {cutter.alignment_mm - spare_mm:.2f} mm less than the tolerance of "
                f"manual alignment ({cutter.alignment_mm:g} mm); increase the overhang or the pad "
                "pitch"
            )


def _coverage_mm(crossing: Rect, *, pixel: Rect, corner_mm: float) -> float:
    """Return the least margin of a pixel around a rectangle, mm; negative if not covered.

    The edge of a rounded rectangle is `corner_mm` outside an inner rectangle. The margin follows
    from the distance of the inner rectangle to each corner of the crossing.
    """
    x, y = pixel.centre
    least = math.inf
    for corner_x, corner_y in product(
        (crossing.left, crossing.right), (crossing.top, crossing.bottom)
    ):
        out_x = abs(corner_x - x) - (pixel.width / 2 - corner_mm)
        out_y = abs(corner_y - y) - (pixel.height / 2 - corner_mm)
        distance_mm = math.hypot(max(out_x, 0.0), max(out_y, 0.0)) + min(max(out_x, out_y), 0.0)
        least = min(least, corner_mm - distance_mm)
    return least


def _check_leaks(pattern: Pattern, *, cutter: Cutter) -> Iterator[str]:
    """Yield problems of copper too close to a pixel of another row or column."""
    nets = [(f"R{r}", r, -1, net) for r, net in enumerate(pattern.rows)]
    nets += [(f"C{c}", -1, c, net) for c, net in enumerate(pattern.cols)]
    for pixel in pattern.pixels:
        for name, row, col, net in nets:
            if pixel.row == row or pixel.col == col:
                continue
            gap_mm = min(rect.distance(pixel.body) for rect in net.rects())
            if cutter.gap_mm - gap_mm > _TINY_MM:
                yield (
                    f"copper of {name} is {gap_mm:.2f} mm from pixel {_name(pixel)}, "
                    f"{cutter.gap_mm - gap_mm:.2f} mm less than the smallest gap "
                    f"({cutter.gap_mm:g} mm)"
                )


def _name(pixel: Pixel) -> str:
    return f"R{pixel.row} C{pixel.col}"
