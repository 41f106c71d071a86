"""Which bin: the rules applied to what is known of an item, and the reason in a sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from palpate.produce.sorting.conditions import CONDITIONS, Evidence, KindIs, percent
from palpate.produce.sorting.rules import Rule, RuleBook

Answer = Literal["yes", "no", "unsure"]


@dataclass(frozen=True, slots=True, kw_only=True)
class BinDecision:
    """Where an item goes."""

    #: The bin; the default one where no rule is sure.
    bin: str
    #: The rule that decides so; None for the default.
    rule: Rule | None
    #: That all the rule's conditions hold; None for the default.
    probability: float | None
    #: Whether another grasp may settle what is unsure; the bin then is only for now.
    again: bool
    #: The reason, for people.
    why: str


def decide(book: RuleBook, evidence: Evidence) -> BinDecision:
    """Apply the rules: the first that is sure of all its conditions wins.

    Where an earlier rule can't decide yet, or none is sure, another grasp is asked for, as long as
    it can help and there are grasps left. What looks unknown at its first grasp is grasped again
    too: one bad grasp is no stranger.

    `evidence`: all that is known, every grasp so far together.

    >>> from palpate.estimate.measurement import Measurement
    >>> from palpate.produce.sorting.conditions import SizeWithin
    >>> small = Rule(bin="small", conditions=(SizeWithin(low=0, high=45),), line=2)
    >>> book = RuleBook(rules=(small,), default_bin="by hand", most_grasps=2)
    >>> size = Measurement(value=44.0, low=43.5, high=44.5, unit="mm")
    >>> decide(book, Evidence(size_mm=size, grasps=1)).why
    'small: 44.0 mm (43.5 to 44.5) within 0 to 45; rule in line 2 met with 100 %; 1 grasp'
    >>> size = Measurement(value=45.0, low=44.0, high=46.0, unit="mm")
    >>> decide(book, Evidence(size_mm=size, grasps=1)).again
    True
    """
    left = evidence.grasps < book.most_grasps
    open_before, sure = False, None
    for rule in book.rules:
        answer, helps = _verdict(rule, evidence)
        if answer == "yes":
            sure = rule
            break
        open_before = open_before or helps
    rejected = evidence.identity is not None and evidence.identity.rejected
    doubted = rejected and evidence.grasps < 2
    again = left and (open_before or doubted or evidence.grasps == 0)
    count = f"{evidence.grasps} grasp{'s' if evidence.grasps != 1 else ''}"
    if sure is None:
        why = f"{book.default_bin} (default): {_no_rule(book, evidence)}; {count}"
        return BinDecision(bin=book.default_bin, rule=None, probability=None, again=again, why=why)
    probability = sure.probability(evidence)[0]
    why = (
        f"{sure.bin}: {_reasons(sure, evidence)}; rule in line {sure.line} met with "
        f"{percent(probability)}; {count}"
    )
    return BinDecision(bin=sure.bin, rule=sure, probability=probability, again=again, why=why)


def _verdict(rule: Rule, evidence: Evidence) -> tuple[Answer, bool]:
    """Return a rule's answer, and whether another grasp may change a doubt of it."""
    low, high = rule.probability(evidence)
    if low >= rule.confidence:
        return "yes", False
    if high <= 1.0 - rule.confidence:
        return "no", False
    # A grasp measures some of what is asked. A verdict that was never given stays unknown.
    by_touch = any(condition.asks is None for condition in rule.conditions)
    return "unsure", by_touch and not rule.lacking(evidence)


def _reasons(rule: Rule, evidence: Evidence) -> str:
    return ", ".join(condition.reason(evidence) for condition in rule.conditions)


def _all_words(book: RuleBook, evidence: Evidence) -> str:
    """Name all that is known of what any rule asks for; the kind in any case."""
    is_kind_known = evidence.identity is not None
    forms = (
        form
        for form in CONDITIONS.values()
        if book.asks(form) or (form is KindIs and is_kind_known)
    )
    return ", ".join(filter(None, (form.known(evidence) for form in forms))) or "not measured"


def _no_rule(book: RuleBook, evidence: Evidence) -> str:
    """Return why no rule is sure: the one that came nearest, and what it lacked."""
    nearest = max(book.rules, key=lambda rule: rule.probability(evidence)[1])
    low, high = nearest.probability(evidence)
    known = _all_words(book, evidence)
    if high <= 1.0 - nearest.confidence:
        return f"{known}, which no rule takes"
    if lacking := nearest.lacking(evidence):
        return f"{known}; the rule in line {nearest.line} asks {lacking}, which is not known"
    return (
        f"{known}; the rule in line {nearest.line} ({nearest.bin}) comes nearest: "
        f"{percent(low)}, {percent(nearest.confidence)} needed"
    )
