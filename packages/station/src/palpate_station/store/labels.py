"""Labels that people give to items: the training data."""

from __future__ import annotations

from datetime import UTC, datetime

from palpate_station.records import About, Source, Verdict
from palpate_station.store.database import Store


def add_label(store: Store, item_id: str, *, about: About, text: str, by: str = "") -> None:
    """Store a label that a person gave to an item.

    The label is linked to the item's latest grasp. `by`: name of the person, kept in the details;
    empty if unknown.
    """
    grasps = store.grasps_of(item_id)
    store.add_verdict(
        Verdict(
            item_id=item_id,
            about=about,
            text=text,
            given_at=datetime.now(UTC),
            details={"by": by} if by else {},
            source=Source.PERSON,
            grasp_id=grasps[-1].grasp_id if grasps else None,
        )
    )
