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
from palpate_station.bruise.model import (
    BRUISED,
    REFERENCES,
    SOUND,
    BruiseModel,
    Side,
    build_contrast_tables,
)
from palpate_station.bruise.shape import LoadShape, fit_load_shape, median_shape, pixel_contrast
from palpate_station.learning import LabelledTable
from palpate_station.records import About, Grasp, Source, Verdict

if TYPE_CHECKING:
    from palpate_station.store import Store


#: Maximum pause between grasps of one visit. Earlier visits are the item's history.
_VISIT = timedelta(minutes=30)
#: Minimum number of grasps of sound items for the reference "class". No further items are read
#: after the second number of grasps.
_FEWEST_SOUND, _MOST_SOUND = 6, 200
#: Maximum angle between grasps of the same side, and minimum angle between independent sides,
#: degrees.
_SAME_SIDE_DEG, _OTHER_SIDE_DEG = 15.0, 45.0
#: A pixel may be on the bruise if its load is at least 20 % below that of the facing pixel.
_LOG_LOAD_DROP = math.log(1.25)


@dataclass(frozen=True, slots=True, kw_only=True)
class SideVerdict:
    """The verdict on one side."""

    #: Angle of the side.
    angle_deg: float
    #: Probability that the side is bruised.
    probability: float
    #: Number of grasps. Their log odds are averaged, so more grasps do not raise the confidence.
    grasps: int
    #: Name of the reference in `REFERENCES`.
    against: str
    #: Mean relative change over all pixels.
    mean_percent: float
    #: Pixels with a load at least 20 % below that of the facing pixel, and their mean relative
    #: change. On a bruised side some of these pixels are on the bruise.
    pixels: tuple[tuple[int, int], ...]
    pixels_percent: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemBruise:
    """The verdict on an item."""

    #: Sides grasped in the last visit, highest probability of a bruise first.
    sides: tuple[SideVerdict, ...]
    #: Mean change over all pixels on the first visit of the first side; None without one.
    before_percent: float | None
    #: Whether any grasp is simulated.
    simulated: bool
    #: Model of the probabilities.
    model: BruiseModel

    @property
    def probability(self) -> float:
        """Highest probability of a bruise among the sides."""
        return self.sides[0].probability

    @property
    def is_bruised(self) -> bool:
        """Whether the probability of a bruise is at least one half."""
        return self.probability >= 0.5

    @property
    def explanation(self) -> str:
        """The reason in a sentence."""
        side = self.sides[0]
        return (
            f"side {side.angle_deg:g}° compared with {_REFERENCE_TEXTS[side.against]}: "
            f"{100 * side.probability:.0f} % bruised"
        )

    def make_verdict(self, item_id: str, *, given_at: datetime) -> Verdict:
        """Return the verdict for the store."""
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


_REFERENCE_TEXTS = {
    "history": "its earlier grasps",
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
    """Judge an item from its last visit, store the verdict, and return the result.

    `bruised_fraction`: prior probability that a side is bruised.
    Raises `InputError` if the item is unknown, has no grasp with pixels, has no reference of the
    model, or has too few pixels in use.
    """
    item = store.item(item_id)
    grasps = usable_grasps(store.grasps_of(item_id))
    if not grasps:
        raise InputError(
            f"item {item_id!r}: no completed grasp with width-driven fingers has pixel data; "
            "grasp it again with width-driven fingers"
        )
    sound = sound_grasps(store, kind=item.kind, excluded_item_id=item_id)
    visits = group_visits(grasps)
    measured = [(grasp, _side(grasp, visits=visits, sound=sound)) for grasp in visits[-1]]
    measured = [one for one in measured if one[1].against]
    if not measured:
        raise InputError(
            f"item {item_id!r}: no reference to compare with. Grasp another side of the item "
            "(--angle-deg 90), or this side on several visits, or state its kind and label sound "
            f"items of this kind: palpate items NAME --set kind=apple --say bruise={SOUND}"
        )
    sides: list[list[tuple[Grasp, Side]]] = []
    for one in measured:
        # A turn by 180 degrees exchanges the fingers and is a different side.
        same = [side for side in sides if _angle_deg(side[0][0], one[0], 360.0) <= _SAME_SIDE_DEG]
        if same:
            same[0].append(one)
        else:
            sides.append([one])
    verdicts = sorted(
        (_judge_side(side, model=model, bruised_fraction=bruised_fraction) for side in sides),
        key=lambda verdict: -verdict.probability,
    )
    before = _earlier_grasps(verdicts[0].angle_deg, visits=visits)
    found = ItemBruise(
        sides=tuple(verdicts),
        before_percent=float(np.nanmean([pixel_changes(one) for one in before]))
        if before
        else None,
        simulated=any(grasp.is_simulated for grasp in grasps),
        model=model,
    )
    store.add_verdict(found.make_verdict(item_id, given_at=given_at))
    return found


def _judge_side(
    measured: Sequence[tuple[Grasp, Side]], *, model: BruiseModel, bruised_fraction: float
) -> SideVerdict:
    """Judge the grasps of one side together."""
    log_odds = float(np.mean([model.log_odds(side) for _, side in measured]))
    change = np.nanmean([pixel_changes(grasp) for grasp, _ in measured], axis=0)
    grasp, last = measured[-1]
    name = model.choose_reference(last)
    rows, cols = change.shape
    load = pixel_contrast(last.shape, last.against[name], rows=rows, cols=cols)
    marked = (load <= -_LOG_LOAD_DROP) & np.isfinite(change)
    return SideVerdict(
        angle_deg=grasp.angle_deg or 0.0,
        probability=float(expit(log_odds + logit(bruised_fraction))),
        grasps=len(measured),
        against=name,
        mean_percent=float(np.nanmean(change)),
        pixels=tuple((int(row), int(col)) for row, col in np.argwhere(marked)),
        pixels_percent=float(change[marked].mean()) if marked.any() else None,
    )


def learn_bruise_model(store: Store, *, kind: str) -> BruiseModel:
    """Learn from items of a kind labelled bruised or sound.

    Raises `InputError` if there are too few labels; `MissingExtraError` if scikit-learn is not
    installed.
    """
    known = read_labelled_sides(store, kind=kind)
    items = len({item for table in known.values() for item in table.items})
    return BruiseModel.learn(
        known, learned_on=f"{items} labelled items of kind {kind} of the store"
    )


def read_labelled_sides(store: Store, *, kind: str) -> dict[str, LabelledTable]:
    """Return the labelled sides of a kind's items, bruised or sound, by reference.

    For a bruised item only one grasp is used: the labelled grasp, or else the last grasp before the
    label. Label the item right after a grasp of its bruised side. For a sound item all grasps are
    used.
    """
    sides: list[tuple[str, bool, Side]] = []
    for item_id, label in _labels(store, kind=kind).items():
        grasps = usable_grasps(store.grasps_of(item_id))
        visits = group_visits(grasps)
        sound = sound_grasps(store, kind=kind, excluded_item_id=item_id)
        if label.text == BRUISED:
            chosen = [one for one in grasps if one.grasp_id == label.grasp_id]
            chosen = chosen or [one for one in grasps if one.taken_at <= label.given_at][-1:]
        else:
            chosen = list(grasps)
        for grasp in chosen:
            known = [visit for visit in visits if visit[0].taken_at <= grasp.taken_at]
            side = _side(grasp, visits=known, sound=sound)
            sides.append((item_id, label.text == BRUISED, side))
    return build_contrast_tables(sides)


def usable_grasps(grasps: Sequence[Grasp]) -> tuple[Grasp, ...]:
    """Return completed grasps with pixel data, by fingers driven by width."""
    return tuple(
        grasp
        for grasp in grasps
        if grasp.outcome is Outcome.HELD
        and grasp.drive == "width"
        and grasp.pixel_settled_percent is not None
    )


def group_visits(grasps: Sequence[Grasp]) -> list[list[Grasp]]:
    """Group grasps, oldest first, into visits without long pauses."""
    visits: list[list[Grasp]] = []
    for grasp in grasps:
        if visits and grasp.taken_at - visits[-1][-1].taken_at <= _VISIT:
            visits[-1].append(grasp)
        else:
            visits.append([grasp])
    return visits


def sound_grasps(store: Store, *, kind: str | None, excluded_item_id: str) -> list[Grasp]:
    """Return usable grasps of items labelled sound; none without a kind."""
    found: list[Grasp] = []
    if kind is None:
        return found
    for item_id, label in reversed(_labels(store, kind=kind).items()):
        if label.text == SOUND and item_id != excluded_item_id and len(found) < _MOST_SOUND:
            found += usable_grasps(store.grasps_of(item_id))
    return found


def pixel_changes(grasp: Grasp) -> FloatArray:
    """Return the change of each pixel, NaN for faulty pixels, shape (rows, cols)."""
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
    """Return a grasp of the last visit with its references."""
    rows = len(grasp.pixel_settled_percent or ())
    comparable = [
        one
        for one in sound
        if one.rig == grasp.rig and len(one.pixel_settled_percent or ()) == rows
    ]
    others = [one for one in visits[-1] if _angle_deg(one, grasp, 180.0) >= _OTHER_SIDE_DEG]
    before = _earlier_grasps(grasp.angle_deg or 0.0, visits=visits)
    against = {}
    for name, grasps, fewest in zip(
        REFERENCES, (before, comparable, others), (1, _FEWEST_SOUND, 1), strict=True
    ):
        if len(grasps) >= fewest:
            against[name] = median_shape(
                [_shape(one) for one in grasps], with_width=name != "class"
            )
    return Side(shape=_shape(grasp), against=against)


def _earlier_grasps(angle_deg: float, *, visits: Sequence[Sequence[Grasp]]) -> list[Grasp]:
    """Return the grasps of a side on its first visit; empty without an earlier visit."""
    for visit in visits[:-1]:
        same = [
            one
            for one in visit
            if abs(math.remainder((one.angle_deg or 0.0) - angle_deg, 360.0)) <= _SAME_SIDE_DEG
        ]
        if same:
            return same
    return []


def _angle_deg(one: Grasp, other: Grasp, period_deg: float) -> float:
    """Return the angle between two grasps; a period of 180 ignores which finger is first."""
    return abs(math.remainder((one.angle_deg or 0.0) - (other.angle_deg or 0.0), period_deg))
