"""Everything that is known of one item, as a page to look at."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from palpate.estimate.measurement import Measurement
from palpate.produce.records import About, Grasp, Item, Verdict
from palpate.produce.store.database import Store


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemHistory:
    """One item with its history, oldest first."""

    #: Which.
    item: Item
    #: With their measurements.
    grasps: tuple[Grasp, ...]
    #: By palpate and by people.
    verdicts: tuple[Verdict, ...]

    @property
    def simulated(self) -> bool:
        """Whether any of its grasps is simulated."""
        return any(grasp.simulated for grasp in self.grasps)

    def latest(self, name: str) -> Measurement | None:
        """Return a measurement of the last grasp that has it."""
        found = (grasp.measurements.get(name) for grasp in reversed(self.grasps))
        return next((measured for measured in found if measured is not None), None)

    def said(self, about: About) -> Verdict | None:
        """Return the last verdict on a subject."""
        found = (verdict for verdict in reversed(self.verdicts) if verdict.about is about)
        return next(found, None)

    def within(self, since: datetime, until: datetime) -> ItemHistory:
        """Return grasps and verdicts at or after `since`, and before `until`."""
        return replace(
            self,
            grasps=tuple(g for g in self.grasps if since <= g.taken_at < until),
            verdicts=tuple(v for v in self.verdicts if since <= v.given_at < until),
        )


def item_page(store: Store, item_id: str) -> ItemHistory:
    """Gather the page of an item.

    Raises `InputError` if there is no such item.
    """
    return item_pages(store, [store.item(item_id)])[0]


def item_pages(store: Store, items: Sequence[Item]) -> tuple[ItemHistory, ...]:
    """Gather the pages of several items, in their order."""
    histories = store.histories([item.item_id for item in items])
    return tuple(
        ItemHistory(item=item, grasps=grasps, verdicts=verdicts)
        for item, (grasps, verdicts) in zip(items, histories, strict=True)
    )
