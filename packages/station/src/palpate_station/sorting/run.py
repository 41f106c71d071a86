"""Sorting of one item, from the first grasp to its bin."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import datetime

from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate_station.identify.identifier import Identifier, Identity, combine, label_identity
from palpate_station.identify.kinds import item_features
from palpate_station.records import About, Grasp, Verdict
from palpate_station.sorting.conditions import Evidence
from palpate_station.sorting.hand import TimedGrasp
from palpate_station.sorting.rules import BinDecision, RuleBook, decide


@dataclass(frozen=True, slots=True, kw_only=True)
class Sorted:
    """A sorted item."""

    #: Name of the item.
    item_id: str
    #: Bin and reason.
    decision: BinDecision
    #: Kind of the item; None if it was not identified.
    identity: Identity | None
    #: Size from all grasps.
    size_mm: Measurement | None
    #: All grasps in order, including failed grasps.
    grasps: tuple[Grasp, ...]
    #: Total duration of the grasps.
    grasping_s: float


def sort_item(
    item_id: str,
    *,
    book: RuleBook,
    identifier: Identifier | None,
    grasp: Callable[[int, Measurement | None], TimedGrasp],
    kind: str | None = None,
    verdicts: Sequence[Verdict] = (),
) -> Sorted:
    """Grasp an item until the rules decide or the grasps are used up.

    `identifier`: the trained identifier; None for rules without a class condition.
    `grasp`: called with the number of the grasp and the size so far; turns and grasps the item and
        returns the grasp.
    `kind`: kind stated by a person; replaces the identification.
    `verdicts`: stored verdicts; the latest ripeness and bruise verdicts are used.
    """
    done: list[TimedGrasp] = []
    while True:
        grasps = [one.grasp for one in done]
        evidence = combine_evidence(grasps, identifier=identifier, kind=kind, verdicts=verdicts)
        decision = decide(book, evidence)
        if not decision.needs_regrasp or len(done) >= book.most_grasps:
            return Sorted(
                item_id=item_id,
                # Grasps that did not hold are not repeated without end.
                decision=replace(decision, needs_regrasp=False),
                identity=evidence.identity,
                size_mm=evidence.size_mm,
                grasps=tuple(grasps),
                grasping_s=sum(one.lasted_s for one in done),
            )
        done.append(grasp(len(done), evidence.size_mm))


def combine_evidence(
    grasps: Sequence[Grasp],
    *,
    identifier: Identifier | None,
    kind: str | None = None,
    verdicts: Sequence[Verdict] = (),
    class_fault: str = "",
) -> Evidence:
    """Combine the evidence of grasps and verdicts on an item.

    `class_fault`: why there is no identifier, although the rules need one.
    """
    held = [one for one in grasps if one.outcome is Outcome.HELD]
    points = item_features(held)
    identity = None if kind is None else label_identity(kind)
    if identity is None and identifier is not None and points:
        identity = identifier.identify(points)
    last = {one.about: one for one in sorted(verdicts, key=lambda one: one.given_at)}
    return Evidence(
        identity=identity,
        class_fault=class_fault if identity is None else "",
        size_mm=_average(held, "size_mm"),
        firmness=_average(held, "firmness"),
        ripeness=_stages(last[About.RIPENESS]) if About.RIPENESS in last else {},
        bruised=_bruise_probability(last[About.BRUISE]) if About.BRUISE in last else None,
        grasps=len(held),
    )


def _average(grasps: Sequence[Grasp], name: str) -> Measurement | None:
    found = [one for grasp in grasps if (one := grasp.find_value(name)) is not None]
    return combine(found) if found else None


def _stages(verdict: Verdict) -> dict[str, float]:
    """Return the probability of each stage, or of the verdict's stage alone."""
    stages = verdict.details.get("probabilities")
    if isinstance(stages, Mapping):
        return {str(stage): float(p) for stage, p in stages.items()}
    return {verdict.text: 1.0 if verdict.probability is None else verdict.probability}


def _bruise_probability(verdict: Verdict) -> float:
    """Return the probability of a bruise, from a verdict of "bruised" or "sound"."""
    probability = 1.0 if verdict.probability is None else verdict.probability
    return probability if verdict.text == "bruised" else 1.0 - probability


def bin_verdict(done: Sorted, *, given_at: datetime) -> Verdict:
    """Return the verdict for the store, linked to the latest grasp."""
    return Verdict(
        item_id=done.item_id,
        about=About.BIN,
        text=done.decision.bin,
        given_at=given_at,
        probability=done.decision.probability,
        explanation=done.decision.why,
        details={
            "rule_line": None if done.decision.rule is None else done.decision.rule.line,
            "grasps": len(done.grasps),
        },
        grasp_id=done.grasps[-1].grasp_id if done.grasps else None,
    )
