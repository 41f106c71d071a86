"""A second population of a mixed crate: two cultivars of each kind, and flesh under a skin.

Fixed before anything was scored on it. Sizes of a kind crowd at both ends of its range, which is no
normal distribution; everything but shells has a skin on softer flesh and a core
(`second.things.layered`), so that its stiffness depends on how far it is pressed.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from palpate.twin.crate import CRATE_STRANGERS, CRATE_TAUGHT, CrateItem
from palpate.twin.objects import TwinObject
from palpate_studies.second.things import layered


@dataclass(frozen=True, slots=True, kw_only=True)
class OtherItem(CrateItem):
    """An item whose sides have a skin; shells stay as they are."""

    def side(self, turn: int) -> TwinObject:
        """Return the item as it lies after this many turns."""
        lies = CrateItem.side(self, turn)
        return lies if lies.contact == "linear" else layered(lies)


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
