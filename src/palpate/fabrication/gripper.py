"""A two-finger gripper to cut from one sheet: a hobby servo turns a pinion between two racks.

The finger of each rack carries a pad, on which a sensor is glued. Drawn and checked for fit, not
built yet. Everything is in millimetres, seen from above, with the pinion's axis at the origin, x
along the racks, and the fingers towards negative y.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from palpate.errors import InputError
from palpate.fabrication.shapes import (
    Outline,
    PointMm,
    Rect,
    Vertex,
    circle,
    polygon,
    round_rect,
)

#: Gears of module 1 mm (pitch over pi) with teeth of 20 degrees: ISO 53, profile A. An even number
#: of teeth, so that one shape of rack fits both sides.
TEETH, _ADDENDUM, _DEDENDUM, _ANGLE = 28, 1.0, 1.25, math.radians(20.0)
PITCH_RADIUS = TEETH / 2
#: Openings between the pads at the ends of the travel.
OPEN, CLOSED = 74.0, 5.0
#: A servo of the standard size: window of the body, its middle from the shaft, and the holes of the
#: flange (MG996R, data sheet: body 40.7 x 19.7 mm; holes and shaft as usual for the size, measure).
_BODY, _SHAFT_OFF, _FLANGE, _FLANGE_HOLE = (41.2, 20.2), 10.0, (49.5, 10.0), 4.2
#: Holes for M3, for heads of M4, and for a round horn of up to 20 mm.
_M3, _HEAD, _HORN = 3.2, 8.0, 22.0
#: Width of a rack behind its teeth, of a finger, and of the rails beside the racks.
_BACK, _FINGER, _RAIL = 9.0, 16.0, 8.0
#: Between a rack and its rail. A laser's kerf (0.1 to 0.2) adds to it, and gives the gears play.
_PLAY = 0.1
#: Pad: along the finger, and above it.
PAD = (30.0, 30.0)
_NOTCH, _TIP, _GAP, _SLIDER = 8.0, 95.0, 4.0, 6.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Part:
    """One shape: its edge, its holes, and how many to cut."""

    name: str
    edge: Outline
    holes: tuple[Outline, ...] = ()
    count: int = 1

    def move(self, dx: float, dy: float) -> Part:
        """Return it elsewhere."""
        edge, *holes = (_move(outline, dx, dy) for outline in (self.edge, *self.holes))
        return Part(name=self.name, edge=edge, holes=tuple(holes), count=self.count)

    @property
    def box(self) -> Rect:
        """The rectangle around it; exact where its edge bulges nowhere beyond its corners."""
        xs = [vertex.x for vertex in self.edge.vertices]
        ys = [vertex.y for vertex in self.edge.vertices]
        return Rect(left=min(xs), top=min(ys), right=max(xs), bottom=max(ys))


def list_parts(*, thickness_mm: float = 3.0) -> tuple[Part, ...]:
    """Return all parts where they lie when the gripper is closed; the other finger's are turned.

    Raises `InputError` if the sheet is thinner than 2 mm or thicker than 6.

    >>> [f"{part.count} {part.name}" for part in list_parts()]  # doctest: +NORMALIZE_WHITESPACE
    ['1 base', '1 deck', '1 lid', '1 pinion', '2 rack', '2 rail', '2 slider', '2 spacer',
     '2 finger', '2 pad', '4 gusset']
    """
    if not 2.0 <= thickness_mm <= 6.0:
        raise InputError(f"--thickness {thickness_mm:g}: cut it from a sheet of 2 to 6 mm")
    half_height = _outer_mm() + _PLAY + _RAIL
    plate = Rect(left=-56.0, top=-half_height, right=56.0, bottom=half_height)
    bolts = [(x, y) for x in (-50.0, 0.0, 50.0) for y in (-_rail_mm(), _rail_mm())]
    bolted = [circle(bolt, diameter=_M3) for bolt in bolts]
    body = Rect.around((_SHAFT_OFF, 0.0), width=_BODY[0], height=_BODY[1])
    flange = [
        (_SHAFT_OFF + dx * _FLANGE[0] / 2, dy * _FLANGE[1] / 2) for dx in (-1, 1) for dy in (-1, 1)
    ]
    deck_holes = [circle((0.0, 0.0), diameter=_HORN)]
    deck_holes += [circle(hole, diameter=_HEAD) for hole in flange]
    return (
        Part(
            name="base",
            edge=round_rect(plate, radius=3.0),
            holes=(
                *bolted,
                round_rect(body, radius=0.5),
                *(circle(hole, diameter=_FLANGE_HOLE) for hole in flange),
            ),
        ),
        Part(name="deck", edge=round_rect(plate, radius=3.0), holes=(*bolted, *deck_holes)),
        Part(
            name="lid",
            edge=round_rect(plate, radius=3.0),
            holes=(*bolted, circle((0.0, 0.0), diameter=12.0), _slot(1.0), _slot(-1.0)),
        ),
        Part(name="pinion", edge=draw_pinion(), holes=tuple(_horn_holes())),
        Part(name="rack", edge=draw_rack(CLOSED), holes=tuple(_finger_holes()), count=2),
        Part(
            name="rail",
            edge=round_rect(
                Rect(left=-56.0, top=-half_height, right=56.0, bottom=-_outer_mm() - _PLAY),
                radius=1.0,
            ),
            holes=tuple(circle(bolt, diameter=_M3) for bolt in bolts if bolt[1] < 0),
            count=2,
        ),
        # In the slot and on the lid: so the finger clears the heads of the bolts.
        _draw_spacer("slider", height=_SLIDER),
        _draw_spacer("spacer", height=10.0),
        *_draw_finger(thickness_mm),
    )


def draw_pinion() -> Outline:
    """Return the pinion, a tooth towards each rack: involutes, straight below the base circle."""
    base = PITCH_RADIUS * math.cos(_ANGLE)
    root, tip = PITCH_RADIUS - _DEDENDUM, PITCH_RADIUS + _ADDENDUM
    flank = [(root, _half_tooth(base))]
    flank += [
        (radius, _half_tooth(radius)) for radius in (base + k * (tip - base) / 8 for k in range(9))
    ]
    points = []
    for tooth in range(TEETH):
        middle = 2 * math.pi * tooth / TEETH + math.pi / 2
        points += [_polar(radius, middle - half) for radius, half in flank]
        points += [_polar(radius, middle + half) for radius, half in reversed(flank)]
    return polygon(points)


def draw_rack(opening_mm: float) -> Outline:
    """Return the rack of the right finger at an opening, its teeth towards the pinion below it."""
    pitch, face = math.pi, opening_mm / 2
    # A gap faces the pinion's upper tooth where the gripper is half open, and so everywhere.
    middle = (OPEN + CLOSED) / 4
    tip, root = -PITCH_RADIUS + _ADDENDUM, -PITCH_RADIUS - _DEDENDUM
    first, last = face - OPEN / 2 - pitch, face - CLOSED / 2 + pitch
    points: list[PointMm] = []
    count = math.ceil((last - first) / pitch)
    for tooth in range(count):
        centre = face - middle + (tooth - count // 2 + 0.5) * pitch
        wide = pitch / 4 + _DEDENDUM * math.tan(_ANGLE)
        narrow = pitch / 4 - _ADDENDUM * math.tan(_ANGLE)
        points += [
            (centre + dx, y)
            for dx, y in ((-wide, root), (-narrow, tip), (narrow, tip), (wide, root))
        ]
    left, right, top = points[0][0] - 1.0, face + _FINGER, -_outer_mm()
    return polygon([(left, root), *points, (right, root), (right, top), (left, top)])


def _half_tooth(radius: float) -> float:
    """Return half of the angle that a tooth fills at a radius."""

    def involute(angle: float) -> float:
        return math.tan(angle) - angle

    base = PITCH_RADIUS * math.cos(_ANGLE)
    return math.pi / (2 * TEETH) + involute(_ANGLE) - involute(math.acos(base / max(radius, base)))


def _polar(radius: float, angle: float) -> PointMm:
    return radius * math.cos(angle), radius * math.sin(angle)


def _outer_mm() -> float:
    """Return how far from the middle a rack's back is."""
    return PITCH_RADIUS + _DEDENDUM + _BACK


def _rail_mm() -> float:
    return _outer_mm() + _PLAY + _RAIL / 2


def _finger_mm() -> float:
    """Return how far from the middle the bolts are that carry a finger."""
    return PITCH_RADIUS + _DEDENDUM + _BACK / 2


def _finger_holes() -> Iterator[Outline]:
    """Yield the two holes by which a finger is bolted to its rack, the gripper closed."""
    for along in (4.0, 12.0):
        yield circle((CLOSED / 2 + along, -_finger_mm()), diameter=_M3)


def _slot(side: float) -> Outline:
    """Return the lid's slot for the bolts of one finger: the right one's for 1, else for -1."""
    inner, outer = CLOSED / 2, OPEN / 2 + _FINGER
    middle = (side * (inner + outer) / 2, -side * _finger_mm())
    return round_rect(Rect.around(middle, width=outer - inner, height=_SLIDER + 0.4), radius=0.5)


def _draw_spacer(name: str, *, height: float) -> Part:
    middle = (CLOSED / 2 + _FINGER / 2, -_finger_mm())
    edge = round_rect(Rect.around(middle, width=_FINGER - 1.0, height=height), radius=0.5)
    return Part(name=name, edge=edge, holes=tuple(_finger_holes()), count=2)


def _horn_holes() -> Iterator[Outline]:
    """Yield the hole over the horn's screw, and four slots for the screws of any round horn."""
    yield circle((0.0, 0.0), diameter=7.0)
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        wide, high = (4.5, 2.0) if dx else (2.0, 4.5)
        yield round_rect(Rect.around((7.5 * dx, 7.5 * dy), width=wide, height=high), radius=0.9)


def _draw_finger(thickness: float) -> Iterator[Part]:
    """Yield finger, pad, and the gussets that stand behind a pad on its finger."""
    face, tip = CLOSED / 2, -_TIP
    pad_at = tip + 2.0 + PAD[0] / 2
    notches = [
        (pad_at + side * 8.0 - _NOTCH / 2, pad_at + side * 8.0 + _NOTCH / 2) for side in (-1, 1)
    ]
    inner: list[PointMm] = [(face, tip)]
    for top, bottom in notches:
        inner += [(face, top), (face + thickness, top), (face + thickness, bottom), (face, bottom)]
    foot = _finger_mm() + _FINGER / 2
    right = face + _FINGER
    gussets = [pad_at - PAD[0] / 2 + 4.0, pad_at + PAD[0] / 2 - 4.0]
    yield Part(
        name="finger",
        edge=polygon([*inner, (face, foot), (right, foot), (right, tip)]),
        # Holes for either rack, so that both fingers are of one shape, one of them turned over.
        holes=(
            *_finger_holes(),
            *(_move(hole, 0.0, 2 * _finger_mm()) for hole in _finger_holes()),
            *(
                polygon(_corners(face + thickness + 3.0, y - thickness / 2, 6.0, thickness))
                for y in gussets
            ),
        ),
        count=2,
    )
    # Pad and gusset lie beside the finger; here z of the finished gripper points upwards.
    left, low = right + _GAP, tip
    tabs = [(left + 2.0 + PAD[0] / 2 + side * 8.0) - 2.0 for side in (-1, 1)]
    tabbed: list[PointMm] = []
    for tab in reversed(tabs):
        tabbed += [
            (tab + _NOTCH / 2, low + PAD[1]),
            (tab + _NOTCH / 2, low + PAD[1] + thickness),
            (tab - _NOTCH / 2, low + PAD[1] + thickness),
            (tab - _NOTCH / 2, low + PAD[1]),
        ]
    yield Part(
        name="pad",
        edge=polygon(
            [
                (left, low),
                (left + PAD[0], low),
                (left + PAD[0], low + PAD[1]),
                *tabbed,
                (left, low + PAD[1]),
            ]
        ),
        count=2,
    )
    left += PAD[0] + _GAP
    depth = _FINGER - thickness - 1.0
    yield Part(
        name="gusset",
        edge=polygon(
            [
                (left, low),
                (left + 2.0, low),
                (left + depth, low + 20.0),
                (left + depth, low + 22.0),
                (left + 9.0, low + 22.0),
                (left + 9.0, low + 22.0 + thickness),
                (left + 3.0, low + 22.0 + thickness),
                (left + 3.0, low + 22.0),
                (left, low + 22.0),
            ]
        ),
        count=4,
    )


def _corners(left: float, top: float, width: float, height: float) -> list[PointMm]:
    return [(left, top), (left + width, top), (left + width, top + height), (left, top + height)]


def nest(parts: Sequence[Part], *, width_mm: float = 300.0) -> tuple[list[Part], Rect]:
    """Return every piece on one sheet, in shelves from the highest part on, and the sheet.

    >>> pieces, sheet = nest(list_parts())
    >>> len(pieces), round(sheet.width), sheet.height < 300
    (20, 300, True)
    """
    found: list[Part] = []
    x = y = shelf = _GAP
    pieces = [part for part in parts for _ in range(part.count)]
    for part in sorted(pieces, key=lambda part: -part.box.height):
        box = part.box
        if x + box.width + _GAP > width_mm:
            x, y, shelf = _GAP, shelf + _GAP, shelf
        found.append(part.move(x - box.left, y - box.top))
        x += box.width + _GAP
        shelf = max(shelf, y + box.height)
    return found, Rect(left=0.0, top=0.0, right=width_mm, bottom=shelf + _GAP)


def turn(part: Part) -> Part:
    """Return a part of the right side as that of the left one.

    It is turned by half a turn; a finger is turned over, so that both point the same way.
    """
    flip = 1.0 if part.name == "finger" else -1.0
    edge, *holes = (
        Outline(
            vertices=tuple(
                Vertex(x=-v.x, y=flip * v.y, bulge=-flip * v.bulge) for v in outline.vertices
            )
        )
        for outline in (part.edge, *part.holes)
    )
    return Part(name=part.name, edge=edge, holes=tuple(holes), count=part.count)


def _move(outline: Outline, dx: float, dy: float) -> Outline:
    return Outline(
        vertices=tuple(Vertex(x=v.x + dx, y=v.y + dy, bulge=v.bulge) for v in outline.vertices)
    )
