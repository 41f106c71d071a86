"""History of an item from the store, and its JSON documents.

The JSON schemas are `item.json` and `items.json` in `docs/schemas`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from datetime import datetime
from typing import Any

from palpate.grasp.document import ItemFacts
from palpate.measurement import Measurement
from palpate_station.records import MEASURED, About, Drive, Grasp, Item, Source, Verdict
from palpate_station.store.database import Store

#: Maximum number of other items of the same kind (newest first) for the firmness rank, and the
#: required minimum (assumed).
_MOST_OF_KIND, _FEWEST_OF_KIND = 200, 8


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmnessRank:
    """Rank of an item's firmness among items of the same kind."""

    #: Number of other items with a firmness from the same kind of gripper.
    items: int
    #: Fraction of these items that are softer.
    softer: float

    @property
    def text(self) -> str:
        """The rank as text."""
        return f"firmer than {100 * self.softer:.0f} % of {self.items} items of its kind"


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemHistory:
    """One item with its history, oldest first."""

    #: The item.
    item: Item
    #: Grasps with their measurements.
    grasps: tuple[Grasp, ...]
    #: Verdicts by palpate and by people.
    verdicts: tuple[Verdict, ...]
    #: Reason why grasps of other stations may be missing; empty if the shared store answered.
    away: str = ""
    #: Rank among items of the same kind; None if too few are known.
    firmness_rank: FirmnessRank | None = None

    @property
    def is_simulated(self) -> bool:
        """Whether any grasp is simulated."""
        return any(grasp.is_simulated for grasp in self.grasps)

    def latest(self, name: str) -> Measurement | None:
        """Return the latest measurement or bound with this name, or None if there is none."""
        found = (grasp.measurements.get(name) for grasp in reversed(self.grasps))
        return next((measured for measured in found if measured is not None), None)

    def latest_value(self, name: str) -> Measurement | None:
        """Return the latest measurement with this name and a value, or None if there is none."""
        found = (grasp.find_value(name) for grasp in reversed(self.grasps))
        return next((measured for measured in found if measured is not None), None)

    def latest_verdict(self, about: About) -> Verdict | None:
        """Return the latest verdict on a subject, or None if there is none.

        A person's bin counts more than those of later grasps.
        """
        found = [verdict for verdict in self.verdicts if verdict.about is about]
        if about is About.BIN:
            found = [one for one in found if one.source is Source.PERSON] or found
        return found[-1] if found else None

    def select_period(self, since: datetime, until: datetime) -> ItemHistory:
        """Return the history at or after `since`, and before `until`."""
        return replace(
            self,
            grasps=tuple(g for g in self.grasps if since <= g.taken_at < until),
            verdicts=tuple(v for v in self.verdicts if since <= v.given_at < until),
        )


def read_item_history(store: Store, item_id: str) -> ItemHistory:
    """Read the history of an item, with its firmness rank.

    Raises `InputError` if the item is unknown.
    """
    item = store.item(item_id)
    page = read_item_histories(store, [item])[0]
    drive = page.grasps[-1].drive if page.grasps else "width"
    own = _last_firmness(page.grasps, drive)
    if item.kind is None or own is None:
        return page
    others = [one for one in store.items(kind=item.kind, limit=_MOST_OF_KIND) if one != item]
    grasps = [grasps for grasps, _ in store.histories([one.item_id for one in others])]
    known = [value for one in grasps if (value := _last_firmness(one, drive)) is not None]
    if len(known) < _FEWEST_OF_KIND:
        return page
    softer = sum(value < own for value in known) / len(known)
    return replace(page, firmness_rank=FirmnessRank(items=len(known), softer=softer))


def _last_firmness(grasps: Sequence[Grasp], drive: Drive) -> float | None:
    """Return the latest firmness measured with this drive, or None if there is none."""
    same_drive = (grasp for grasp in reversed(grasps) if grasp.drive == drive)
    found = (grasp.find_value("firmness") for grasp in same_drive)
    return next((measured.middle for measured in found if measured is not None), None)


#: Note on an item while the shared store does not answer. Notes are stored and shown to operators,
#: so they contain neither its address nor its error, which are in the log.
AWAY_NOTE = "the shared store does not answer: grasps of other stations may be missing"


def read_item_histories(store: Store, items: Sequence[Item]) -> tuple[ItemHistory, ...]:
    """Read the histories of several items, in the same order."""
    histories = store.histories([item.item_id for item in items])
    read = list(zip(items, histories, strict=True))
    away = "" if store.away is None else AWAY_NOTE
    return tuple(
        ItemHistory(item=item, grasps=grasps, verdicts=verdicts, away=away)
        for item, (grasps, verdicts) in read
    )


def item_facts(
    item_id: str, *, kind: str | None = None, verdicts: Sequence[Verdict] = ()
) -> ItemFacts:
    """Return an item with its latest verdicts, as `item` in the JSON of a grasp.

    `kind`: kind stated by a person.

    >>> item_facts("A17", kind="kiwi")
    ItemFacts(id='A17', kind='kiwi', stage=None, bruised=None)
    """
    last = {one.about: one.text for one in sorted(verdicts, key=lambda one: one.given_at)}
    bruise = last.get(About.BRUISE)
    return ItemFacts(
        id=item_id,
        kind=kind or last.get(About.IDENTITY),
        stage=last.get(About.RIPENESS),
        bruised=None if bruise is None else bruise == "bruised",
    )


def is_provisional(verdict: Verdict) -> bool:
    """Return whether a verdict is a bin that another grasp of the item may change."""
    return verdict.details.get("provisional") is True


def items_document(pages: Sequence[ItemHistory]) -> dict[str, Any]:
    """Return the JSON document of a list of items."""
    return {"items": [_item_row(page) for page in pages], **_away_note(pages)}


def item_document(page: ItemHistory) -> dict[str, Any]:
    """Return the JSON document of one item."""
    return {
        "item": record_as_dict(page.item),
        "simulated": page.is_simulated,
        "grasps": [record_as_dict(grasp) for grasp in page.grasps],
        "verdicts": [record_as_dict(verdict) for verdict in page.verdicts],
        **({} if page.firmness_rank is None else {"firmness_rank": asdict(page.firmness_rank)}),
        **_away_note([page]),
    }


def record_as_dict(record: Item | Grasp | Verdict) -> dict[str, Any]:
    """Return a record as JSON values: its fields by name, times in ISO 8601.

    >>> record_as_dict(Item(item_id="A17", kind="kiwi"))["kind"]
    'kiwi'
    """
    values = {f.name: getattr(record, f.name) for f in fields(record)}
    for name, value in values.items():
        if isinstance(value, datetime):
            values[name] = value.isoformat()
    if isinstance(record, Grasp):
        values["measurements"] = {
            name: measured.to_dict() for name, measured in record.measurements.items()
        }
    if isinstance(record, Verdict):
        values["details"] = dict(record.details)
    return values


def _away_note(pages: Sequence[ItemHistory]) -> dict[str, str]:
    return next(({"away": page.away} for page in pages if page.away), {})


def _item_row(page: ItemHistory) -> dict[str, Any]:
    latest = {name: page.latest(name) for name in MEASURED}
    verdicts = {about: page.latest_verdict(about) for about in About}
    return {
        **record_as_dict(page.item),
        "simulated": page.is_simulated,
        "grasps": len(page.grasps),
        "last_taken_at": page.grasps[-1].taken_at.isoformat() if page.grasps else None,
        **{name: None if value is None else value.to_dict() for name, value in latest.items()},
        "verdicts": {
            str(about): None
            if one is None
            else {"text": one.text, "probability": one.probability, "source": str(one.source)}
            for about, one in verdicts.items()
        },
    }
