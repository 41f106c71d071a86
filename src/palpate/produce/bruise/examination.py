"""Bruises of items in the store: comparison of grasps, learning from labels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import datetime, timedelta
from typing import TYPE_CHECKING

import numpy as np
from scipy.special import expit, logit

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.grasp.result import Outcome
from palpate.produce.bruise.model import (
    BRUISED,
    REFERENCES,
    SOUND,
    BruiseModel,
    Side,
    table_sides,
)
from palpate.produce.bruise.shape import LoadShape, fit_load_shape, median_shape, pixel_contrast
from palpate.produce.learning import LabelledTable
from palpate.produce.records import About, Grasp, Source, Verdict

if TYPE_CHECKING:
    from palpate.produce.store import Store


#: Grasps without a longer pause between them are one visit; the visits before are the record.
_VISIT = timedelta(minutes=30)
#: Fewest grasps of sound items that make a class, and most that count.
_FEWEST_SOUND, _MOST_SOUND = 6, 200


#: Sides closer than this are one side, placed again; and sides that face other flesh are at least
#: this far apart, degrees.
_SAME_SIDE_DEG, _OTHER_SIDE_DEG = 15.0, 45.0
#: A pixel that carries at least a fifth less than the one that it faces may lie on the bruise.
_LESS = math.log(1.25)


@dataclass(frozen=True, slots=True, kw_only=True)
class SideVerdict:
    """The verdict on one side."""

    #: Which side.
    angle_deg: float
    #: That it is bruised.
    probability: float
    #: How many grasps it rests on: the mean of their log odds is taken, which promises no more than
    #: one grasp does.
    grasps: int
    #: The reference it was compared with.
    against: str
    #: Mean relative change over all pixels.
    mean_percent: float
    #: Pixels that carry at least a fifth less than the ones that they face: if the side is bruised,
    #: some of them lie on the bruise. And their mean relative change.
    pixels: tuple[tuple[int, int], ...]
    pixels_percent: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemBruise:
    """The verdict on an item."""

    #: Each side grasped in the last visit, the most suspicious first.
    sides: tuple[SideVerdict, ...]
    #: Of the most suspicious side, mean change over all pixels in its earlier record.
    before_percent: float | None
    #: Whether any grasp that went in was.
    simulated: bool
    #: Who judged.
    model: BruiseModel

    @property
    def probability(self) -> float:
        """Probability that the most suspicious side is bruised."""
        return self.sides[0].probability

    @property
    def is_bruised(self) -> bool:
        """Whether that is more likely than not."""
        return self.probability >= 0.5

    @property
    def explanation(self) -> str:
        """The reason in a sentence."""
        side = self.sides[0]
        return (
            f"side {side.angle_deg:g}° against {_IN_WORDS[side.against]}: "
            f"{100 * side.probability:.0f} % bruised"
        )

    def verdict(self, item_id: str, *, given_at: datetime) -> Verdict:
        """Return the verdict as stored."""
        return Verdict(
            item_id=item_id,
            about=About.BRUISE,
            text=BRUISED if self.is_bruised else SOUND,
            given_at=given_at,
            probability=self.probability if self.is_bruised else 1.0 - self.probability,
            explanation=self.explanation,
            details={
                "learned_on": self.model.learned_on,
                "sides": [asdict(side) for side in self.sides],
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
    bruised_fraction: float = 0.5,
    given_at: datetime,
) -> ItemBruise:
    """Judge an item by its last visit, store the verdict, and return it.

    `bruised_fraction`: fraction of sides expected to be bruised before any grasp.
    Raises `InputError` if there is no such item, no grasp of it recorded pixels, or there is
    nothing to compare it with.
    """
    item = store.item(item_id)
    grasps = usable_grasps(store.grasps_of(item_id))
    if not grasps:
        raise InputError(
            f"item {item_id!r}: no held grasp of it recorded every pixel; grasp it "
            "again with fingers driven by width"
        )
    sound = sound_grasps(store, kind=item.kind, without=item_id)
    visits = group_visits(grasps)
    felt = [(grasp, _side(grasp, visits=visits, sound=sound)) for grasp in visits[-1]]
    felt = [one for one in felt if one[1].against]
    if not felt:
        raise InputError(
            f"item {item_id!r}: nothing to compare it with. Grasp another side of it "
            "(--angle-deg 90), or have an earlier record of this side, or state its kind and label "
            f"sound items of it: palpate items NAME --set kind=apple --say bruise={SOUND}"
        )
    sides: list[list[tuple[Grasp, Side]]] = []
    for one in felt:
        # Turned by half a turn, the fingers change places: that is another side.
        alike = [side for side in sides if _turn_deg(side[0][0], one[0], 360.0) <= _SAME_SIDE_DEG]
        if alike:
            alike[0].append(one)
        else:
            sides.append([one])
    verdicts = sorted(
        (_judge_side(side, model=model, bruised_fraction=bruised_fraction) for side in sides),
        key=lambda verdict: -verdict.probability,
    )
    before = _record_of(verdicts[0].angle_deg, visits=visits)
    found = ItemBruise(
        sides=tuple(verdicts),
        before_percent=float(np.nanmean([pixel_changes(one) for one in before]))
        if before
        else None,
        simulated=any(grasp.is_simulated for grasp in grasps),
        model=model,
    )
    store.add_verdict(found.verdict(item_id, given_at=given_at))
    return found


def _judge_side(
    felt: Sequence[tuple[Grasp, Side]], *, model: BruiseModel, bruised_fraction: float
) -> SideVerdict:
    """Judge the grasps of one side together."""
    log_odds = float(np.mean([model.log_odds(side) for _, side in felt]))
    change = np.nanmean([pixel_changes(grasp) for grasp, _ in felt], axis=0)
    grasp, last = felt[-1]
    name = model.choose_reference(last)
    rows, cols = change.shape
    load = pixel_contrast(last.shape, last.against[name], rows=rows, cols=cols)
    marked = (load <= -_LESS) & np.isfinite(change)
    return SideVerdict(
        angle_deg=grasp.angle_deg or 0.0,
        probability=float(expit(log_odds + logit(bruised_fraction))),
        grasps=len(felt),
        against=name,
        mean_percent=float(np.nanmean(change)),
        pixels=tuple((int(row), int(col)) for row, col in np.argwhere(marked)),
        pixels_percent=float(change[marked].mean()) if marked.any() else None,
    )


def learn_bruise_model(store: Store, *, kind: str) -> BruiseModel:
    """Learn from items of a kind labelled bruised or sound.

    Raises `InputError` if there are too few; `MissingExtraError` if scikit-learn is not installed.
    """
    known = read_labelled_sides(store, kind=kind)
    items = len({item for table in known.values() for item in table.items})
    return BruiseModel.learn(
        known, learned_on=f"{items} labelled items of kind {kind} of the store"
    )


def read_labelled_sides(store: Store, *, kind: str) -> dict[str, LabelledTable]:
    """Return the labelled sides of a kind's items, bruised or sound, by reference.

    Of a bruised item the grasp that the label names counts, or else the last one before it: label
    it after a grasp of its bruised side. Of a sound item all sides count.
    """
    sides: list[tuple[str, bool, Side]] = []
    for item_id, label in _labels(store, kind=kind).items():
        grasps = usable_grasps(store.grasps_of(item_id))
        visits = group_visits(grasps)
        sound = sound_grasps(store, kind=kind, without=item_id)
        if label.text == BRUISED:
            chosen = [one for one in grasps if one.grasp_id == label.grasp_id]
            chosen = chosen or [one for one in grasps if one.taken_at <= label.given_at][-1:]
        else:
            chosen = list(grasps)
        for grasp in chosen:
            known = [visit for visit in visits if visit[0].taken_at <= grasp.taken_at]
            felt = _side(grasp, visits=known, sound=sound)
            sides.append((item_id, label.text == BRUISED, felt))
    return table_sides(sides)


def usable_grasps(grasps: Sequence[Grasp]) -> tuple[Grasp, ...]:
    """Return grasps by width that held and recorded every pixel."""
    return tuple(
        grasp
        for grasp in grasps
        if grasp.outcome is Outcome.HELD
        and grasp.drive == "width"
        and grasp.pixel_settled_percent is not None
    )


def group_visits(grasps: Sequence[Grasp]) -> list[list[Grasp]]:
    """Return grasps, oldest first, in visits without long pauses."""
    visits: list[list[Grasp]] = []
    for grasp in grasps:
        if visits and grasp.taken_at - visits[-1][-1].taken_at <= _VISIT:
            visits[-1].append(grasp)
        else:
            visits.append([grasp])
    return visits


def sound_grasps(store: Store, *, kind: str | None, without: str) -> list[Grasp]:
    """Return grasps of a kind's items labelled sound, newest first.

    Without a kind there are none.
    """
    found: list[Grasp] = []
    if kind is None:
        return found
    for item_id, label in reversed(_labels(store, kind=kind).items()):
        if label.text == SOUND and item_id != without and len(found) < _MOST_SOUND:
            found += usable_grasps(store.grasps_of(item_id))
    return found


def pixel_changes(grasp: Grasp) -> FloatArray:
    """Return the change of each pixel, NaN for faulty ones, shape (rows, cols)."""
    return np.array(grasp.pixel_settled_percent, dtype=np.float64)


def _labels(store: Store, *, kind: str) -> dict[str, Verdict]:
    """Return each item's latest label, ordered by each item's first label."""
    return {
        verdict.item_id: verdict
        for verdict in store.verdicts(About.BRUISE, source=Source.PERSON, kind=kind)
        if verdict.text in (BRUISED, SOUND)
    }


def _shape(grasp: Grasp) -> LoadShape:
    size = grasp.measurements.get("size_mm")
    return fit_load_shape(pixel_changes(grasp), width_mm=None if size is None else size.value)


def _side(grasp: Grasp, *, visits: Sequence[Sequence[Grasp]], sound: Sequence[Grasp]) -> Side:
    """Return a grasp of the latest session with its references."""
    rows = len(grasp.pixel_settled_percent or ())
    alike = [
        one
        for one in sound
        if one.rig == grasp.rig and len(one.pixel_settled_percent or ()) == rows
    ]
    others = [one for one in visits[-1] if _turn_deg(one, grasp, 180.0) >= _OTHER_SIDE_DEG]
    before = _record_of(grasp.angle_deg or 0.0, visits=visits)
    against = {}
    for name, grasps, fewest in zip(
        REFERENCES, (before, alike, others), (1, _FEWEST_SOUND, 1), strict=True
    ):
        if len(grasps) >= fewest:
            against[name] = median_shape(
                [_shape(one) for one in grasps], with_width=name != "class"
            )
    return Side(shape=_shape(grasp), against=against)


def _record_of(angle_deg: float, *, visits: Sequence[Sequence[Grasp]]) -> list[Grasp]:
    """Return the grasps of a side on its earliest visit; none without an earlier visit."""
    for visit in visits[:-1]:
        same = [
            one
            for one in visit
            if abs(math.remainder((one.angle_deg or 0.0) - angle_deg, 360.0)) <= _SAME_SIDE_DEG
        ]
        if same:
            return same
    return []


def _turn_deg(one: Grasp, other: Grasp, whole_deg: float) -> float:
    """Return the angle between the sides of two grasps; swapped fingers (180) are alike."""
    return abs(math.remainder((one.angle_deg or 0.0) - (other.angle_deg or 0.0), whole_deg))
