"""Second generator of objects and crate items, with force curves that no estimator assumes.

The generator was fixed before anything was scored on it. In its crates the sizes of a kind cluster
at both ends of the range, unlike a normal distribution. All items except shells have a skin on
softer flesh and a core (`layered`), so that the stiffness depends on the deformation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from palpate.twin.crate import TRAINED_KINDS, UNTRAINED_KINDS, CrateItem
from palpate.twin.objects import TwinObject

#: Thickness of the skin, mm, and its stiffness relative to the flesh; depth of the core, mm, and
#: its relative stiffness.
_SKIN_MM, _SKIN_STIFFER, _CORE_MM, _CORE_STIFFER = 0.4, 3.0, 4.0, 6.0
#: Exponent of foam; the twin's own laws have 1 and 1.5.
_FOAM_EXPONENT = 2.5
#: Relaxing fractions of dough, and their time constants, s.
_DOUGH_FRACTIONS, _DOUGH_TIMES_S = (0.25, 0.15, 0.10), (0.08, 0.6, 20.0)
#: Points of a curve, and its largest deformation, mm.
_POINTS, _UP_TO_MM = 60, 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherItem(CrateItem):
    """An item whose sides have a skin; shells are unchanged."""

    def side(self, turn: int) -> TwinObject:
        """Return the upper side of the item after this many turns."""
        side = CrateItem.side(self, turn)
        return side if side.contact == "linear" else make_layered(side)


def other_item(item: CrateItem) -> OtherItem:
    """Return the item of the second generator for an item of the first.

    Examples
    --------
    >>> from palpate.twin.crate import draw_crate
    >>> sizes = [other_item(item).mean.size_mm for item in draw_crate(["kiwi"] * 200, seed=1)]
    >>> sum(47.5 < size < 52.5 for size in sizes) < 80
    True
    """
    low, high = {**TRAINED_KINDS, **UNTRAINED_KINDS}[item.kind].size_mm
    place = (item.mean.size_mm - low) / (high - low)
    size_mm = low + (high - low) * float(np.sin(0.5 * np.pi * place) ** 2)
    known = {field.name: getattr(item, field.name) for field in fields(CrateItem)}
    return OtherItem(**known | {"mean": replace(item.mean, size_mm=size_mm)})


def other_object(obj: TwinObject, *, number: int) -> TwinObject:
    """Return the object as layered, foam or dough, in turn by its number."""
    return (make_layered, make_foam, make_dough)[number % 3](obj)


def make_layered(obj: TwinObject) -> TwinObject:
    """Return the object with skin, softer flesh and core: its stiffness falls, then rises."""
    flesh = obj.force_at_1mm_n
    skin_n = _SKIN_STIFFER * flesh * _SKIN_MM
    core_n = skin_n + flesh * (_CORE_MM - _SKIN_MM)
    end_n = core_n + _CORE_STIFFER * flesh * (_UP_TO_MM - _CORE_MM)
    points = ((0.0, 0.0), (_SKIN_MM, skin_n), (_CORE_MM, core_n), (_UP_TO_MM, end_n))
    return _replace_curve(obj, points, name="layered")


def make_foam(obj: TwinObject) -> TwinObject:
    """Return the object with a curve that stiffens faster than Hertz contact."""
    at_mm = np.linspace(0.0, _UP_TO_MM, _POINTS)
    force_n = obj.force_at_1mm_n * at_mm**_FOAM_EXPONENT
    return _replace_curve(
        obj, tuple(zip(at_mm.tolist(), force_n.tolist(), strict=True)), name="foam"
    )


def make_dough(obj: TwinObject) -> TwinObject:
    """Return the object with a relaxation of half of its force, mostly at once."""
    return replace(
        obj, name="dough", relaxing_fractions=_DOUGH_FRACTIONS, relaxing_time_s=_DOUGH_TIMES_S
    )


def _replace_curve(
    obj: TwinObject, points: Sequence[tuple[float, float]], *, name: str
) -> TwinObject:
    """Return the object with another curve and the same deformation at yield."""
    yields_mm = (obj.yield_n / obj.force_at_1mm_n) ** (1.0 / obj.exponent)
    at_mm, force_n = np.array(points).T
    yield_n = float(np.interp(yields_mm, at_mm, force_n))
    return replace(obj, name=name, curve=tuple(points), yield_n=yield_n, rupture_n=1.2 * yield_n)
