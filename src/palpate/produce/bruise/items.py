"""Bruises of items in the store: which grasps are compared, and what people's labels teach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.grasp.result import Outcome
from palpate.produce.bruise.judge import (
    OTHER_SIDE_DEG,
    SAME_SIDE_DEG,
    FeltSide,
    SideVerdict,
    apart_deg,
    judge_sides,
)
from palpate.produce.bruise.model import REFERENCES, BruiseModel, Example, learn_bruises
from palpate.produce.bruise.shape import LoadShape, middle_of, shape_of
from palpate.produce.records import About, Grasp, Source, Verdict

if TYPE_CHECKING:
    from palpate.produce.store import Store


#: What people call an item, for others to be learned from: `palpate items A17 --say bruise=sound`.
BRUISED, SOUND = "bruised", "sound"
#: Grasps without a longer pause between them are one visit; the visits before are the record.
_VISIT = timedelta(minutes=30)
#: Fewest grasps of sound items that make a class, and most that are looked at.
_FEWEST_SOUND, _MOST_SOUND = 6, 200


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemBruise:
    """The verdict on an item."""

    #: Each side felt in the last visit, the most suspicious first.
    sides: tuple[SideVerdict, ...]
    #: The paper's three columns for the most suspicious side: mean change over all pixels in its
    #: earlier record and now, and of the pixels on the bruise.
    before_percent: float | None
    now_percent: float
    bruised_percent: float | None
    #: Whether any grasp that went in was.
    simulated: bool
    #: Who judged.
    model: BruiseModel

    @property
    def probability(self) -> float:
        """Probability that the most suspicious side is bruised."""
        return self.sides[0].probability

    @property
    def bruised(self) -> bool:
        """Whether that is more likely than not."""
        return self.probability >= 0.5

    @property
    def explanation(self) -> str:
        """Why, in a sentence."""
        side = self.sides[0]
        against = " and ".join(_IN_WORDS[name] for name in side.against)
        text = f"side {side.angle_deg:g}° against {against}: {100 * side.probability:.0f} % bruised"
        if self.bruised and side.spots:
            text += ", at " + " or ".join(spot.in_words for spot in side.spots)
        return text

    def verdict(self, item_id: str, *, given_at: datetime) -> Verdict:
        """Return the form that the store keeps."""
        return Verdict(
            item_id=item_id,
            about=About.BRUISE,
            text=BRUISED if self.bruised else SOUND,
            given_at=given_at,
            probability=self.probability if self.bruised else 1.0 - self.probability,
            explanation=self.explanation,
            details={
                "learned_on": self.model.learned_on,
                "sides": [side.to_dict() for side in self.sides],
            },
        )


_IN_WORDS = {
    "history": "its own earlier record",
    "class": "sound items of its kind",
    "item": "its other sides",
}


def examine_item(
    store: Store,
    item_id: str,
    *,
    model: BruiseModel,
    bruised_share: float = 0.5,
    given_at: datetime,
) -> ItemBruise:
    """Judge an item by its last visit, keep the verdict, and return it.

    Raises `InputError` if there is no such item, no grasp of it recorded pixels, or there is
    nothing to compare it with.
    """
    item = store.item(item_id)
    grasps = telling(store.grasps_of(item_id))
    if not grasps:
        raise InputError(
            f"item {item_id!r}: no grasp of it that held recorded what each pixel felt; grasp it "
            "again with fingers driven by width"
        )
    sound = sound_grasps(store, kind=item.kind, without=item_id)
    visits = in_visits(grasps)
    felt = [_features(grasp, visits=visits, sound=sound) for grasp in visits[-1]]
    if not any(one.against for one in felt):
        raise InputError(
            f"item {item_id!r}: nothing to compare it with. Grasp another side of it "
            "(--angle-deg 90), or have an earlier record of this side, or state its kind and label "
            f"sound items of it: palpate items NAME --set kind=apple --say bruise={SOUND}"
        )
    sides = judge_sides(
        [one for one in felt if one.against], model=model, bruised_share=bruised_share
    )
    before = _record_of(sides[0].angle_deg, visits=visits)
    found = ItemBruise(
        sides=sides,
        before_percent=float(np.nanmean([pixels_of(one) for one in before])) if before else None,
        now_percent=sides[0].mean_percent,
        bruised_percent=sides[0].spots[0].mean_percent if sides[0].spots else None,
        simulated=any(grasp.simulated for grasp in grasps),
        model=model,
    )
    store.add_verdict(found.verdict(item_id, given_at=given_at))
    return found


def learn_from(store: Store, *, kind: str) -> BruiseModel:
    """Learn from items of a kind that people called bruised or sound.

    Raises `InputError` if there are too few; `MissingExtraError` if scikit-learn is not installed.
    """
    examples = examples_of(store, kind=kind)
    items = len({item for item, _ in examples})
    return learn_bruises(
        [one for _, one in examples],
        learned_on=f"{items} labelled items of kind {kind} of the store",
    )


def examples_of(store: Store, *, kind: str) -> list[tuple[str, Example]]:
    """Return the sides of items of a kind that people called bruised or sound, with their items.

    Of a bruised item the grasp that the label names counts, or else the last one before it: label
    it when you have just felt its bruised side. Of a sound item all sides count.
    """
    examples: list[tuple[str, Example]] = []
    for item_id, label in _labels(store, kind=kind).items():
        grasps = telling(store.grasps_of(item_id))
        visits = in_visits(grasps)
        sound = sound_grasps(store, kind=kind, without=item_id)
        if label.text == BRUISED:
            chosen = [one for one in grasps if one.grasp_id == label.grasp_id]
            chosen = chosen or [one for one in grasps if one.taken_at <= label.given_at][-1:]
        else:
            chosen = list(grasps)
        for grasp in chosen:
            known = [visit for visit in visits if visit[0].taken_at <= grasp.taken_at]
            felt = _features(grasp, visits=known, sound=sound)
            bruised = label.text == BRUISED
            examples.append(
                (item_id, Example(shape=felt.shape, against=felt.against, bruised=bruised))
            )
    return examples


def telling(grasps: Sequence[Grasp]) -> tuple[Grasp, ...]:
    """Return grasps by width that held and recorded every pixel."""
    return tuple(
        grasp
        for grasp in grasps
        if grasp.outcome is Outcome.HELD
        and grasp.drive == "width"
        and grasp.pixel_settled_percent is not None
    )


def in_visits(grasps: Sequence[Grasp]) -> list[list[Grasp]]:
    """Return grasps, oldest first, in visits without long pauses."""
    visits: list[list[Grasp]] = []
    for grasp in grasps:
        if visits and grasp.taken_at - visits[-1][-1].taken_at <= _VISIT:
            visits[-1].append(grasp)
        else:
            visits.append([grasp])
    return visits


def sound_grasps(store: Store, *, kind: str | None, without: str) -> list[Grasp]:
    """Return grasps of items of a kind that people called sound, the last met first.

    What has no kind has no class.
    """
    found: list[Grasp] = []
    if kind is None:
        return found
    for item_id, label in reversed(_labels(store, kind=kind).items()):
        if label.text == SOUND and item_id != without and len(found) < _MOST_SOUND:
            found += telling(store.grasps_of(item_id))
    return found


def pixels_of(grasp: Grasp) -> FloatArray:
    """Return what each pixel felt, NaN where it is out of use, shape (rows, cols)."""
    return np.array(grasp.pixel_settled_percent, dtype=np.float64)


def _labels(store: Store, *, kind: str) -> dict[str, Verdict]:
    """Return the last word of a person on each item, in the order of the first."""
    return {
        verdict.item_id: verdict
        for verdict in store.verdicts(About.BRUISE, source=Source.PERSON, kind=kind)
        if verdict.text in (BRUISED, SOUND)
    }


def _shape(grasp: Grasp) -> LoadShape:
    size = grasp.measurements.get("size_mm")
    return shape_of(pixels_of(grasp), width_mm=None if size is None else size.value)


def _features(
    grasp: Grasp, *, visits: Sequence[Sequence[Grasp]], sound: Sequence[Grasp]
) -> FeltSide:
    """Return a grasp of the last visit with everything that it can be compared with."""
    angle_deg = grasp.angle_deg or 0.0
    rows = len(grasp.pixel_settled_percent or ())
    alike = [
        one
        for one in sound
        if one.rig == grasp.rig and len(one.pixel_settled_percent or ()) == rows
    ]
    others = [
        one for one in visits[-1] if apart_deg(one.angle_deg or 0.0, angle_deg) >= OTHER_SIDE_DEG
    ]
    before = _record_of(angle_deg, visits=visits)
    against = {}
    for name, grasps, fewest in zip(
        REFERENCES, (before, alike, others), (1, _FEWEST_SOUND, 1), strict=True
    ):
        if len(grasps) >= fewest:
            against[name] = middle_of([_shape(one) for one in grasps], with_width=name != "class")
    return FeltSide(
        angle_deg=angle_deg,
        shape=_shape(grasp),
        change_percent=pixels_of(grasp),
        against=against,
    )


def _record_of(angle_deg: float, *, visits: Sequence[Sequence[Grasp]]) -> list[Grasp]:
    """Return the earliest visit's grasps of a side, none if the last visit is the first with it."""
    for visit in visits[:-1]:
        same = [
            one
            for one in visit
            if abs((((one.angle_deg or 0.0) - angle_deg + 180.0) % 360.0) - 180.0) <= SAME_SIDE_DEG
        ]
        if same:
            return same
    return []
