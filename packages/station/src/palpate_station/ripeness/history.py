"""Ripeness of stored items, learned from labelled items."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate_station.records import About, Drive, Grasp, Source, Verdict
from palpate_station.ripeness.firmness import DAY_S, DayFirmness, firmness_of, group_by_day
from palpate_station.ripeness.rule import Ripeness, RipenessRule, judge_by_first_day

if TYPE_CHECKING:
    from palpate_station.store import Store


#: Maximum time between a label and its day of grasps, days.
_MAX_LABEL_DISTANCE_DAYS = 0.5
#: Maximum number of labelled items in the training set, the most recently labelled first.
_MOST_ITEMS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmnessHistory:
    """Firmness of an item over time, measured with one kind of gripper."""

    item_id: str
    #: Kind of gripper.
    drive: Drive
    #: Grasps that measured the firmness, oldest first.
    grasps: tuple[Grasp, ...]
    #: Firmness from each grasp.
    firmness: tuple[float, ...]
    #: Firmness on each day.
    days: tuple[DayFirmness, ...]

    def day_of(self, time: datetime) -> float:
        """Return the days from the first grasp to a time."""
        return (time - self.grasps[0].taken_at).total_seconds() / DAY_S

    def nearest_day(self, time: datetime) -> int:
        """Return the index of the measured day nearest to a time."""
        target = self.day_of(time)
        return min(range(len(self.days)), key=lambda k: abs(self.days[k].day - target))


def last_drive(grasps: Sequence[Grasp], *, item_id: str) -> Drive:
    """Return the kind of gripper that grasped an item last.

    Raises `InputError` if the item was never grasped.
    """
    if not grasps:
        raise InputError(f"item {item_id!r} was never grasped; grasp it first")
    return grasps[-1].drive


def firmness_history(grasps: Sequence[Grasp], *, item_id: str, drive: Drive) -> FirmnessHistory:
    """Return the firmness history of an item with one kind of gripper."""
    measured = [
        (grasp, firmness)
        for grasp in grasps
        if grasp.drive == drive and (firmness := firmness_of(grasp)) is not None
    ]
    return FirmnessHistory(
        item_id=item_id,
        drive=drive,
        grasps=tuple(grasp for grasp, _ in measured),
        firmness=tuple(firmness for _, firmness in measured),
        days=group_by_day((grasp.taken_at, firmness) for grasp, firmness in measured),
    )


def learn_rule(
    store: Store,
    *,
    kind: str,
    drive: Drive,
    stages: Sequence[str],
) -> RipenessRule:
    """Learn a rule from the labelled items of a kind.

    Raises the errors of `RipenessRule.learn`, and `InputError` if no item has a label.
    """
    verdicts = store.verdicts(About.RIPENESS, source=Source.PERSON, kind=kind)
    # Of labels given at the same time, the items' names decide, not the random IDs.
    newest = sorted(verdicts, key=lambda one: (one.given_at, one.item_id), reverse=True)
    newest_first = read_labelled_histories(store, newest, drive=drive)
    known = list(islice(newest_first, _MOST_ITEMS))
    if not known:
        raise InputError(
            f"no {kind} has both a ripeness label and a grasp with a {drive}-driven gripper; label "
            f"some items: palpate items ITEM --set kind={kind} --say ripeness={stages[0]}"
        )
    return RipenessRule.learn(
        [history.days for history, _ in known],
        labels=[labels for _, labels in known],
        stages=stages,
    )


def read_labelled_histories(
    store: Store, verdicts: Sequence[Verdict], *, drive: Drive
) -> Iterator[tuple[FirmnessHistory, list[str | None]]]:
    """Yield the firmness history of each labelled item, with a label per day.

    `verdicts`: manually assigned labels; the latest label near a day applies to that day.
    """
    by_item: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        by_item.setdefault(verdict.item_id, []).append(verdict)
    for item_id, given in by_item.items():
        history = firmness_history(store.grasps_of(item_id), item_id=item_id, drive=drive)
        if not history.days:
            continue
        labels: list[str | None] = [None] * len(history.days)
        for verdict in sorted(given, key=lambda one: (one.given_at, one.text)):
            nearest = history.nearest_day(verdict.given_at)
            distance = history.days[nearest].day - history.day_of(verdict.given_at)
            if abs(distance) <= _MAX_LABEL_DISTANCE_DAYS:
                labels[nearest] = verdict.text
        yield history, labels


def judge_ripeness(history: FirmnessHistory, *, rule: RipenessRule | None, ripe: str) -> Ripeness:
    """Judge an item by a rule, or without a rule relative to its first day.

    Raises `InputError` if no grasp measured the firmness, or if there is no rule and the gripper is
    driven by pressure.
    """
    if not history.days:
        raise InputError(
            f"item {history.item_id!r}: no grasp measured its firmness; grasp it with "
            "`palpate grasp --item`"
        )
    if rule is not None:
        return rule.judge(history.days, ripe=ripe)
    if history.drive == "pressure":
        raise InputError(
            f"item {history.item_id!r}: with fingers driven by pressure, stages require labelled "
            "items; label the ripeness of some items (palpate items ITEM --say ripeness=ripe)"
        )
    return judge_by_first_day(history.days)


def make_ripeness_verdict(ripeness: Ripeness, history: FirmnessHistory) -> Verdict:
    """Return the stored verdict of a judgement; equal judgements have the same verdict ID."""
    last, days = history.grasps[-1], ripeness.days_to_ripe
    details: dict[str, object] = {
        "probabilities": dict(ripeness.probabilities),
        "firmness": ripeness.firmness,
        "basis": ripeness.basis,
    }
    if days is not None:
        details |= {
            "days_to_ripe": days.value,
            "days_to_ripe_low": days.low,
            "days_to_ripe_high": days.high,
        }
    name = f"ripeness {last.grasp_id} {ripeness.stage} {ripeness.basis} {ripeness.firmness:.9f}"
    return Verdict(
        item_id=history.item_id,
        about=About.RIPENESS,
        text=ripeness.stage,
        given_at=last.taken_at,
        probability=ripeness.probabilities[ripeness.stage],
        explanation=explain_stage(ripeness, history),
        details=details,
        grasp_id=last.grasp_id,
        verdict_id=str(uuid.uuid5(uuid.NAMESPACE_OID, name)),
    )


def is_assumed(ripeness: Ripeness, history: FirmnessHistory) -> bool:
    """Return whether the stage is only the assumption that the first day is hard."""
    return ripeness.basis == "first day" and len(history.days) == 1


def explain_stage(ripeness: Ripeness, history: FirmnessHistory) -> str:
    """Return the reason for a stage as a sentence."""
    count, days = len(history.grasps), len(history.days)
    count_text = f"grasped {count} time{'s' * (count > 1)} on {days} day{'s' * (days > 1)}"
    if is_assumed(ripeness, history):
        return f"{count_text}: assumed to be hard on its first day, no earlier day to compare"
    probability = f"{100 * ripeness.probabilities[ripeness.stage]:.0f} % {ripeness.stage}"
    basis = {
        "labels": "compared with labelled items",
        "first day": "compared with its first day, when it was assumed to be hard",
    }[ripeness.basis]
    return f"{count_text}: {probability}, {basis}"
