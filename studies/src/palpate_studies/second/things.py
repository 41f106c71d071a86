"""Objects and crate items whose force follows no law that an estimator was written for.

Fixed before anything was scored on them. In a second crate the sizes of a kind crowd at both ends
of its range, which is no normal distribution; everything but shells has a skin on softer flesh and
a core (`layered`), so that its stiffness depends on how far it is pressed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from palpate.twin.crate import CRATE_STRANGERS, CRATE_TAUGHT, CrateItem
from palpate.twin.objects import TwinObject

#: A skin this thick, mm, and this many times as stiff as the flesh under it; a core from here on.
_SKIN_MM, _SKIN_STIFFER, _CORE_MM, _CORE_STIFFER = 0.4, 3.0, 4.0, 6.0
#: Exponent of foam-like objects; the law of the twin's own have 1 and 1.5.
_FOAM_EXPONENT = 2.5
#: Share of its force that a dough-like object loses, and within which times, s.
_DOUGH_SHARES, _DOUGH_TIMES_S = (0.25, 0.15, 0.10), (0.08, 0.6, 20.0)
#: Points of a curve, and how far a drawn one goes, mm.
_POINTS, _UP_TO_MM = 60, 15.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherItem(CrateItem):
    """An item whose sides have a skin; shells stay as they are."""

    def side(self, turn: int) -> TwinObject:
        """Return the item as it lies after this many turns."""
        lies = CrateItem.side(self, turn)
        return lies if lies.contact == "linear" else draw_layered(lies)


def other_item(item: CrateItem) -> OtherItem:
    """Return an item of the second population in place of one of the first.

    Examples
    --------
    >>> from palpate.twin.crate import draw_crate
    >>> sizes = [other_item(item).mean.size_mm for item in draw_crate(["kiwi"] * 200, seed=1)]
    >>> sum(47.5 < size < 52.5 for size in sizes) < 80
    True
    """
    low, high = {**CRATE_TAUGHT, **CRATE_STRANGERS}[item.kind].size_mm
    place = (item.mean.size_mm - low) / (high - low)
    size_mm = low + (high - low) * float(np.sin(0.5 * np.pi * place) ** 2)
    known = {field.name: getattr(item, field.name) for field in fields(CrateItem)}
    return OtherItem(**known | {"mean": replace(item.mean, size_mm=size_mm)})


def other_thing(thing: TwinObject, *, number: int) -> TwinObject:
    """Return an object of one of three forms beyond the twin's laws, in turn."""
    return (draw_layered, foam, dough)[number % 3](thing)


def draw_layered(thing: TwinObject) -> TwinObject:
    """Return an object with skin, softer flesh and core: stiffness falls, then rises."""
    flesh = thing.force_at_1mm_n
    skin_n = _SKIN_STIFFER * flesh * _SKIN_MM
    core_n = skin_n + flesh * (_CORE_MM - _SKIN_MM)
    end_n = core_n + _CORE_STIFFER * flesh * (_UP_TO_MM - _CORE_MM)
    points = ((0.0, 0.0), (_SKIN_MM, skin_n), (_CORE_MM, core_n), (_UP_TO_MM, end_n))
    return _bend_curve(thing, points, name="layered")


def foam(thing: TwinObject) -> TwinObject:
    """Return an object that stiffens faster than a round one in contact does."""
    at_mm = np.linspace(0.0, _UP_TO_MM, _POINTS)
    force_n = thing.force_at_1mm_n * at_mm**_FOAM_EXPONENT
    return _bend_curve(
        thing, tuple(zip(at_mm.tolist(), force_n.tolist(), strict=True)), name="foam"
    )


def dough(thing: TwinObject) -> TwinObject:
    """Return an object that loses half of its force, mostly at once, nearly without recovery."""
    return replace(
        thing, name="dough", relaxing_share=_DOUGH_SHARES, relaxing_time_s=_DOUGH_TIMES_S
    )


def _bend_curve(
    thing: TwinObject, points: Sequence[tuple[float, float]], *, name: str
) -> TwinObject:
    """Return an object with another curve that yields at the deformation at which it did."""
    yields_mm = (thing.yield_n / thing.force_at_1mm_n) ** (1.0 / thing.exponent)
    at_mm, force_n = np.array(points).T
    yield_n = float(np.interp(yields_mm, at_mm, force_n))
    return replace(thing, name=name, curve=tuple(points), yield_n=yield_n, rupture_n=1.2 * yield_n)
