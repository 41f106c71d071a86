"""The gripper drawing: equal lines in both files, no overlapping parts."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import ezdxf
import numpy as np
import pytest
import svgelements
from shapely.geometry import Polygon

HARDWARE = Path(__file__).resolve().parents[3] / "hardware"
SHEET_MM = (296.0, 226.7)


def dxf_lines() -> list[Polygon]:
    space = ezdxf.readfile(HARDWARE / "gripper.dxf").modelspace()
    paths = map(ezdxf.path.make_path, space.query("LWPOLYLINE"))
    return [Polygon([(p.x, SHEET_MM[1] - p.y) for p in path.flattening(0.01)]) for path in paths]


def test_gripper_drawing_parts_do_not_overlap() -> None:
    lines = dxf_lines()
    assert all(line.is_valid for line in lines)
    pieces = [one for one in lines if not any(o.contains(one) for o in lines if o is not one)]
    assert len(pieces) == 20
    assert all(one.distance(other) > 1.0 for one, other in combinations(pieces, 2))
    for piece in pieces:
        left, top, right, bottom = piece.bounds
        assert min(left, top, SHEET_MM[0] - right, SHEET_MM[1] - bottom) > 1.0


@pytest.mark.slow
def test_gripper_drawing_svg_and_dxf_have_the_same_lines() -> None:
    drawing = svgelements.SVG.parse(HARDWARE / "gripper.svg", ppi=25.4)
    paths = [path for path in drawing.elements() if isinstance(path, svgelements.Path)]
    lines = dxf_lines()
    assert len(paths) == len(lines)
    for path, line in zip(paths, lines, strict=True):
        assert np.allclose(path.bbox(), line.bounds, atol=0.02)
