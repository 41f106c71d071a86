"""Plane shapes in millimetres, x right and y down: rectangles, outlines with arcs, strokes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

PointMm: TypeAlias = tuple[float, float]

#: Bulge of a quarter circle, tan(90 degrees / 4).
QUARTER = math.tan(math.pi / 8)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rect:
    """An upright rectangle, mm."""

    left: float
    top: float
    right: float
    bottom: float

    @classmethod
    def from_centre(cls, centre: PointMm, *, width: float, height: float) -> Rect:
        """Return a rectangle of a given size around a centre."""
        x, y = centre
        return cls(
            left=x - width / 2, top=y - height / 2, right=x + width / 2, bottom=y + height / 2
        )

    @property
    def width(self) -> float:
        """Extent along x, mm."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Extent along y, mm."""
        return self.bottom - self.top

    @property
    def centre(self) -> PointMm:
        """Centre of the rectangle, mm."""
        return (self.left + self.right) / 2, (self.top + self.bottom) / 2

    def distance(self, other: Rect) -> float:
        """Return the least distance to another rectangle, mm; 0 if they touch or overlap.

        >>> one = Rect(left=0, top=0, right=2, bottom=2)
        >>> one.distance(Rect(left=5, top=6, right=9, bottom=9))
        5.0
        """
        across = max(self.left - other.right, other.left - self.right, 0.0)
        along = max(self.top - other.bottom, other.top - self.bottom, 0.0)
        return math.hypot(across, along)

    def intersection(self, other: Rect) -> Rect | None:
        """Return the intersection with another rectangle, or None without a common area."""
        left, right = max(self.left, other.left), min(self.right, other.right)
        top, bottom = max(self.top, other.top), min(self.bottom, other.bottom)
        if left >= right or top >= bottom:
            return None
        return Rect(left=left, top=top, right=right, bottom=bottom)


@dataclass(frozen=True, slots=True, kw_only=True)
class Vertex:
    """A corner of an outline.

    `bulge` belongs to the edge that starts at this vertex, as in DXF: the tangent of a quarter of
    the arc's angle, 0 for a straight edge, positive for an arc that turns from +x towards +y.
    """

    x: float
    y: float
    bulge: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Outline:
    """A closed cutting line of straight edges and circular arcs."""

    vertices: tuple[Vertex, ...]

    def mirror(self, width: float) -> Outline:
        """Return the outline as seen from the back of a sheet of a given width.

        >>> spike = polygon([(0, 0), (3, 0), (0, 1)])
        >>> [(v.x, v.y) for v in spike.mirror(10).vertices]
        [(10, 0), (7, 0), (10, 1)]
        """
        return Outline(
            vertices=tuple(Vertex(x=width - v.x, y=v.y, bulge=-v.bulge) for v in self.vertices)
        )

    def edges(self) -> Iterable[tuple[Vertex, Vertex]]:
        """Yield each edge as its two vertices, including the closing edge."""
        return pairwise((*self.vertices, self.vertices[0]))

    def length(self) -> float:
        """Return the length of the cut, mm.

        >>> round(circle((0, 0), diameter=2).length(), 6)
        6.283185
        """
        return sum(
            arc_radius(one, two) * 4 * math.atan(abs(one.bulge))
            if one.bulge
            else math.hypot(two.x - one.x, two.y - one.y)
            for one, two in self.edges()
        )


def arc_radius(one: Vertex, two: Vertex) -> float:
    """Return the radius of the arc from `one` to `two`, mm; `one` needs a bulge."""
    chord = math.hypot(two.x - one.x, two.y - one.y)
    return chord * (1 + one.bulge**2) / (4 * abs(one.bulge))


def polygon(points: Sequence[PointMm]) -> Outline:
    """Return an outline of straight edges."""
    return Outline(vertices=tuple(Vertex(x=x, y=y) for x, y in points))


def round_corners(points: Sequence[PointMm], *, radius: float) -> Outline:
    """Return a polygon of right angles with its corners rounded.

    The edges must be at least twice as long as the radius.

    >>> square = round_corners([(0, 0), (4, 0), (4, 4), (0, 4)], radius=1)
    >>> len(square.vertices), round(square.length(), 4)
    (8, 14.2832)
    """
    if radius == 0:
        return polygon(points)
    vertices: list[Vertex] = []
    for before, corner, after in zip(
        (points[-1], *points[:-1]), points, (*points[1:], points[0]), strict=True
    ):
        into, out = _direction(before, corner), _direction(corner, after)
        turn = math.copysign(1.0, into[0] * out[1] - into[1] * out[0])
        start = (corner[0] - radius * into[0], corner[1] - radius * into[1])
        end = (corner[0] + radius * out[0], corner[1] + radius * out[1])
        vertices += [
            Vertex(x=start[0], y=start[1], bulge=turn * QUARTER),
            Vertex(x=end[0], y=end[1]),
        ]
    edges = pairwise((*vertices, vertices[0]))
    # An edge of exactly twice the radius has no straight part.
    return Outline(vertices=tuple(a for a, b in edges if math.hypot(b.x - a.x, b.y - a.y) > 1e-9))


def round_rect(rect: Rect, *, radius: float) -> Outline:
    """Return a rectangle with rounded corners; a radius of half its size yields a circle."""
    left, top, right, bottom = rect.left, rect.top, rect.right, rect.bottom
    return round_corners(
        [(left, top), (right, top), (right, bottom), (left, bottom)], radius=radius
    )


def circle(centre: PointMm, *, diameter: float) -> Outline:
    """Return a circle."""
    return round_rect(
        Rect.from_centre(centre, width=diameter, height=diameter), radius=diameter / 2
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Stroke:
    """A copper part: a line with right-angled bends and a width for each leg."""

    #: Centre line, mm; neighbouring points differ either in x or in y.
    points: tuple[PointMm, ...]
    #: Width of each leg, mm; one fewer than points.
    widths: tuple[float, ...]

    @classmethod
    def from_points(cls, points: Sequence[PointMm], *, widths: Sequence[float]) -> Stroke:
        """Build a stroke without legs of zero length."""
        used, used_widths = [points[0]], []
        for point, width in zip(points[1:], widths, strict=True):
            if math.dist(point, used[-1]) > 1e-9:
                used.append(point)
                used_widths.append(width)
        return cls(points=tuple(used), widths=tuple(used_widths))

    def outline(self) -> Outline:
        """Return the outline with mitred corners."""
        left, right = self._side(1.0), self._side(-1.0)
        return polygon([*left, *reversed(right)])

    def rects(self) -> tuple[Rect, ...]:
        """Return one rectangle per leg; their union is the area of the outline."""
        legs = list(pairwise(self.points))
        found = []
        for i, (start, end) in enumerate(legs):
            along, half = _direction(start, end), self.widths[i] / 2
            before = self.widths[i - 1] / 2 if i > 0 and self._is_right_angle(i) else 0.0
            after = (
                self.widths[i + 1] / 2 if i + 1 < len(legs) and self._is_right_angle(i + 1) else 0.0
            )
            xs = (start[0] - along[0] * before, end[0] + along[0] * after)
            ys = (start[1] - along[1] * before, end[1] + along[1] * after)
            across_x, across_y = abs(along[1]) * half, abs(along[0]) * half
            found.append(
                Rect(
                    left=min(xs) - across_x,
                    top=min(ys) - across_y,
                    right=max(xs) + across_x,
                    bottom=max(ys) + across_y,
                )
            )
        return tuple(found)

    def _is_right_angle(self, joint: int) -> bool:
        """Return whether the legs before and after a point form a right angle."""
        into = _direction(self.points[joint - 1], self.points[joint])
        out = _direction(self.points[joint], self.points[joint + 1])
        return into[0] * out[0] + into[1] * out[1] == 0

    def _side(self, sign: float) -> list[PointMm]:
        offsets = []
        for (start, end), width in zip(pairwise(self.points), self.widths, strict=True):
            along = _direction(start, end)
            offsets.append((-along[1] * sign * width / 2, along[0] * sign * width / 2))
        side = [_move(self.points[0], offsets[0])]
        for joint in range(1, len(self.points) - 1):
            point, into, out = self.points[joint], offsets[joint - 1], offsets[joint]
            if self._is_right_angle(joint):
                side.append(_move(_move(point, into), out))
            elif into != out:
                side += [_move(point, into), _move(point, out)]
        return [*side, _move(self.points[-1], offsets[-1])]


def _direction(start: PointMm, end: PointMm) -> PointMm:
    """Return the unit vector of an edge along x or y."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    return (math.copysign(1.0, dx), 0.0) if abs(dx) > abs(dy) else (0.0, math.copysign(1.0, dy))


def _move(point: PointMm, by: PointMm) -> PointMm:
    return point[0] + by[0], point[1] + by[1]
