"""Items as the JSON of commands and bridges (`item.json` and `items.json` of `docs/schemas`)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from palpate.produce.records import MEASURED, About
from palpate.produce.records_json import record_as_dict
from palpate.produce.store.item_history import ItemHistory


def items_document(pages: Sequence[ItemHistory]) -> dict[str, Any]:
    """Return the document of a list of items."""
    return {"items": [_line(page) for page in pages]}


def item_document(page: ItemHistory) -> dict[str, Any]:
    """Return the document of one item."""
    return {
        "item": record_as_dict(page.item),
        "simulated": page.simulated,
        "grasps": [record_as_dict(grasp) for grasp in page.grasps],
        "verdicts": [record_as_dict(verdict) for verdict in page.verdicts],
    }


def _line(page: ItemHistory) -> dict[str, Any]:
    latest = {name: page.latest(name) for name in MEASURED}
    verdicts = {about: page.said(about) for about in About}
    return {
        **record_as_dict(page.item),
        "simulated": page.simulated,
        "grasps": len(page.grasps),
        "last_taken_at": page.grasps[-1].taken_at.isoformat() if page.grasps else None,
        **{name: None if value is None else value.as_json() for name, value in latest.items()},
        "verdicts": {
            str(about): None
            if one is None
            else {"text": one.text, "probability": one.probability, "source": str(one.source)}
            for about, one in verdicts.items()
        },
    }
