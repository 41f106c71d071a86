"""A drawing of the cut gripper, open and closed."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.fabrication.gripper import CLOSED, OPEN, Part, draw_pinion, draw_rack, turn
from palpate.fabrication.shapes import Outline, Vertex, arc_radius
from palpate.plots.style import GREY, INK, ORANGE, new_figure, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STEPS_PER_ARC = 16


def draw_gripper(parts: Sequence[Part], path: Path) -> None:
    """Draw a cut gripper closed and open, its lid taken off, with dimensions, into a file.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    by_name = {part.name: part for part in parts}
    with new_figure(rows=1, columns=2, width_in=9.0, height_in=5.2) as (figure, axes):
        for panel, opening_mm in zip(np.ravel(axes), (CLOSED, OPEN), strict=True):
            panel.set_title(f"{opening_mm:g} mm between the pads")
            panel.set_aspect("equal")
            panel.set_xlim(-66, 66)
            panel.set_ylim(48, -104)
            panel.set_axis_off()
            by = (opening_mm - CLOSED) / 2
            pinion = Part(name="pinion", edge=draw_pinion())
            shown = [(by_name["deck"], "#e8e8e8"), (pinion, "#d3b27a")]
            rack = Part(name="rack", edge=draw_rack(opening_mm))
            shown += [(each, "#e3c79a") for each in (rack, turn(rack))]
            shown += [(each, "#c9d7df") for each in (by_name["rail"], turn(by_name["rail"]))]
            finger = by_name["finger"].move(by, 0.0)
            for part, fill in [*shown, (finger, "#9ec1d4"), (turn(finger), "#9ec1d4")]:
                _fill(panel, (part.edge,), fill=fill, opacity=0.75, line=INK)
                for hole in part.holes:
                    panel.plot(*points_of(hole).T, color=GREY, linewidth=0.5)
            y = -99.0
            panel.annotate(
                "",
                (-opening_mm / 2, y),
                (opening_mm / 2, y),
                arrowprops={"arrowstyle": "<->", "color": ORANGE, "shrinkA": 0, "shrinkB": 0},
            )
        deck = by_name["deck"].box
        figure.suptitle(
            f"Gripper for a hobby servo, seen from above without its lid; plate {deck.width:.0f} x "
            f"{deck.height:.0f} mm",
            color=INK,
        )
        save_figure(figure, path)


def _fill(axes: Axes, parts: tuple[Outline, ...], *, fill: str, opacity: float, line: str) -> None:
    for part in parts:
        xy = points_of(part)
        axes.fill(xy[:, 0], xy[:, 1], facecolor=fill, alpha=opacity, linewidth=0)
        axes.plot(xy[:, 0], xy[:, 1], color=line, linewidth=0.6)


def points_of(outline: Outline) -> Any:
    """Return points along an outline, shape (n, 2), closed; arcs as short chords."""
    points = [
        point
        for one, two in pairwise((*outline.vertices, outline.vertices[0]))
        for point in _edge(one, two)
    ]
    return np.array([*points, points[0]])


def _edge(one: Vertex, two: Vertex) -> list[tuple[float, float]]:
    """Return the points of an edge, without its end."""
    if one.bulge == 0:
        return [(one.x, one.y)]
    chord_x, chord_y = two.x - one.x, two.y - one.y
    # The centre lies off the chord's middle, to its left for a positive bulge (y down).
    off = (1 - one.bulge**2) / (4 * one.bulge)
    centre_x = (one.x + two.x) / 2 - off * chord_y
    centre_y = (one.y + two.y) / 2 + off * chord_x
    radius, turn = arc_radius(one, two), 4 * np.arctan(one.bulge)
    start = np.arctan2(one.y - centre_y, one.x - centre_x)
    angles = start + turn * np.arange(_STEPS_PER_ARC) / _STEPS_PER_ARC
    return [(centre_x + radius * np.cos(a), centre_y + radius * np.sin(a)) for a in angles]
