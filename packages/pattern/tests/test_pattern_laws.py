"""Accepted patterns have no shorts, checked with an independent geometry library."""

from __future__ import annotations

from itertools import combinations

import pytest
from hypothesis import event, given, settings
from hypothesis import strategies as st
from shapely.geometry import Polygon, box

from palpate.errors import InputError
from palpate_pattern.design import Cutter, SensorDesign
from palpate_pattern.pattern import Pattern, lay_out
from palpate_pattern.refusals import check_design, check_pattern
from palpate_pattern.shapes import Rect, Stroke

CUTTER = Cutter()


def lengths(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(low, high).map(lambda value: round(value, 2))


designs = st.builds(
    SensorDesign,
    name=st.just("any"),
    rows=st.integers(1, 5),
    cols=st.integers(1, 5),
    pixel_width_mm=lengths(4, 12),
    pixel_height_mm=lengths(4, 12),
    gap_mm=lengths(0.4, 4),
    overhang_mm=lengths(0.45, 1.4),
    trace_mm=lengths(0.95, 2.5),
    pad_width_mm=lengths(0.95, 2.5),
    pad_length_mm=lengths(1, 6),
    pad_pitch_mm=lengths(2, 6),
    tail_mm=lengths(12, 60),
    margin_mm=lengths(0.45, 4),
    substrate_width_mm=st.none() | lengths(40, 120),
)


def is_accepted(design: SensorDesign, pattern: Pattern) -> bool:
    try:
        check_design(design, cutter=CUTTER)
        check_pattern(pattern, cutter=CUTTER)
    except InputError:
        return False
    return True


def copper(net: Stroke) -> Polygon:
    return Polygon([(v.x, v.y) for v in net.outline().vertices])


def area(rect: Rect) -> Polygon:
    return box(rect.left, rect.top, rect.right, rect.bottom)


def is_sound(pattern: Pattern) -> bool:
    """Check gaps within each layer and Velostat at crossings with shapely."""
    rows, cols = [copper(n) for n in pattern.rows], [copper(n) for n in pattern.cols]
    pixels = [area(p.body) for p in pattern.pixels]
    apart = all(
        a.distance(b) >= CUTTER.gap_mm - 1e-5
        for layer in (rows, cols, pixels)
        for a, b in combinations(layer, 2)
    )
    covered = all(
        pixels[r * len(cols) + c]
        .buffer(1e-5)
        .contains(row.intersection(col).buffer(CUTTER.alignment_mm, join_style="mitre"))
        for r, row in enumerate(rows)
        for c, col in enumerate(cols)
    )
    tape = Polygon(pattern.base).union(Polygon(pattern.cover)).buffer(1e-5)
    return apart and covered and all(tape.contains(part) for part in (*rows, *cols, *pixels))


@pytest.mark.slow
@settings(max_examples=300)
@given(design=designs)
def test_accepted_pattern_has_no_shorts_and_full_velostat_cover(design: SensorDesign) -> None:
    pattern = lay_out(design)
    fine = is_accepted(design, pattern)
    event(f"accepted: {fine}")
    assert not fine or is_sound(pattern)


@settings(max_examples=60)
@given(design=designs)
def test_pattern_mirrored_twice_is_unchanged(design: SensorDesign) -> None:
    pattern = lay_out(design)
    for layer in pattern.layers():
        for part in layer.parts:
            back = part.mirror(pattern.width).mirror(pattern.width)
            for one, two in zip(part.vertices, back.vertices, strict=True):
                assert abs(one.x - two.x) < 1e-9
                assert (one.y, one.bulge) == (two.y, two.bulge)
    mirrored = {(round(pattern.width - x, 6), round(y, 6)) for x, y in pattern.marks}
    assert mirrored == {(round(x, 6), round(y, 6)) for x, y in pattern.marks}
