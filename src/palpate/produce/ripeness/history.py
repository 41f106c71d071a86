"""Ripeness of stored items, learned from the labels of some."""

from __future__ import annotations

import uuid
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import islice
from typing import TYPE_CHECKING

from palpate.errors import InputError
from palpate.produce.records import About, Drive, Grasp, Source, Verdict
from palpate.produce.ripeness.firmness import DAY_S, DayFelt, by_day, firmness_of
from palpate.produce.ripeness.rule import Ripeness, RipenessRule, judge_by_first_day

if TYPE_CHECKING:
    from palpate.produce.store import Store


#: A label is of a day of a grasp if it was given this close to it, days.
_SAME_DAY = 0.5
#: At most this many labelled items, the last ones labelled, are learned from.
_MOST_ITEMS = 200


@dataclass(frozen=True, slots=True, kw_only=True)
class FirmnessHistory:
    """An item's firmness over time by one kind of gripper."""

    #: Which item.
    item_id: str
    #: The gripper.
    drive: Drive
    #: Those that measured its firmness, oldest first.
    grasps: tuple[Grasp, ...]
    #: Of each grasp.
    firmness: tuple[float, ...]
    #: The same by day.
    days: tuple[DayFelt, ...]

    def day_of(self, when: datetime) -> float:
        """Return a time in days since the first grasp."""
        return (when - self.grasps[0].taken_at).total_seconds() / DAY_S

    def nearest_day(self, when: datetime) -> int:
        """Return the number of the measured day nearest to a time."""
        at = self.day_of(when)
        return min(range(len(self.days)), key=lambda k: abs(self.days[k].day - at))


def drive_of(grasps: Sequence[Grasp], *, item_id: str) -> Drive:
    """Return the kind of gripper that grasped an item last.

    Raises `InputError` if it was never grasped.
    """
    if not grasps:
        raise InputError(f"item {item_id!r} was never grasped; grasp it first")
    return grasps[-1].drive


def history_of(grasps: Sequence[Grasp], *, item_id: str, drive: Drive) -> FirmnessHistory:
    """Return the firmness history of an item with one kind of gripper."""
    felt: list[tuple[Grasp, float]] = []
    for grasp in grasps:
        firmness = firmness_of(grasp) if grasp.drive == drive else None
        if firmness is not None:
            felt.append((grasp, firmness))
    return FirmnessHistory(
        item_id=item_id,
        drive=drive,
        grasps=tuple(grasp for grasp, _ in felt),
        firmness=tuple(firmness for _, firmness in felt),
        days=by_day((grasp.taken_at, firmness) for grasp, firmness in felt),
    )


def learn_rule(
    store: Store,
    *,
    kind: str,
    drive: Drive,
    stages: Sequence[str],
) -> RipenessRule:
    """Learn from the labelled items of a kind.

    Raises `InputError` if there are too few, or a stage was never given.
    """
    verdicts = store.verdicts(About.RIPENESS, source=Source.PERSON, kind=kind)
    last_first = read_labelled_histories(store, verdicts[::-1], drive=drive)
    known = list(islice(last_first, _MOST_ITEMS))
    if not known:
        raise InputError(
            f"no {kind} grasped by a gripper driven by {drive} is labelled; label the ripeness of "
            f"some: palpate items ITEM --set kind={kind} --say ripeness={stages[0]}"
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

    `verdicts`: of people; the label of a day is the last one given near it.
    """
    by_item: dict[str, list[Verdict]] = {}
    for verdict in verdicts:
        by_item.setdefault(verdict.item_id, []).append(verdict)
    for item_id, given in by_item.items():
        history = history_of(store.grasps_of(item_id), item_id=item_id, drive=drive)
        if not history.days:
            continue
        labels: list[str | None] = [None] * len(history.days)
        for verdict in sorted(given, key=lambda one: one.given_at):
            nearest = history.nearest_day(verdict.given_at)
            if abs(history.days[nearest].day - history.day_of(verdict.given_at)) <= _SAME_DAY:
                labels[nearest] = verdict.text
        yield history, labels


def judge_ripeness(history: FirmnessHistory, *, rule: RipenessRule | None, ripe: str) -> Ripeness:
    """Judge an item by a rule, or by its own first day without one.

    Raises `InputError` if it was never grasped, or there is no rule and the gripper is driven by
    pressure.
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
            f"item {history.item_id!r}: fingers driven by pressure need labelled items to judge "
            "stages; label how ripe some are (palpate items ITEM --say ripeness=ripe)"
        )
    return judge_by_first_day(history.days)


def verdict_of(ripeness: Ripeness, history: FirmnessHistory) -> Verdict:
    """Return a judgement as a verdict of the store; equal judgements give equal verdicts."""
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
        explanation=explanation(ripeness, history),
        details=details,
        grasp_id=last.grasp_id,
        verdict_id=str(uuid.uuid5(uuid.NAMESPACE_OID, name)),
    )


def is_assumed(ripeness: Ripeness, history: FirmnessHistory) -> bool:
    """Whether a judgement is no finding: without labels the first day is hard by assumption."""
    return ripeness.basis == "first day" and len(history.days) == 1


def explanation(ripeness: Ripeness, history: FirmnessHistory) -> str:
    """Return the reason in a sentence."""
    count, days = len(history.grasps), len(history.days)
    felt = f"grasped {count} time{'s' * (count > 1)} on {days} day{'s' * (days > 1)}"
    if is_assumed(ripeness, history):
        return f"{felt}: its first day is taken as hard, there is nothing yet to compare it with"
    chance = f"{100 * ripeness.probabilities[ripeness.stage]:.0f} % {ripeness.stage}"
    basis = {
        "labels": "judged by labelled items",
        "first day": "judged by how it softened since its first day, taken as hard",
    }[ripeness.basis]
    return f"{felt}: {chance} {basis}"
