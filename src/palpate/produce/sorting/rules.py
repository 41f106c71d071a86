"""Sorting rules, the bin that they choose for an item, and the reason.

Each condition of a rule has a probability, and the rule's probability is their product. Without a
verdict that a rule requires, only a range of the probability is known, starting at 0. A rule
therefore applies, does not apply, or is undecided. The item goes to the first rule that applies.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate.produce.sorting.conditions import (
    CONDITIONS,
    VERDICT_CONDITIONS,
    Condition,
    Evidence,
    percent,
)

#: Defaults of a rules file: minimum probability of a rule, and maximum number of grasps.
CONFIDENCE, MOST_GRASPS = 0.8, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One rule."""

    #: Bin of the items that meet the rule.
    bin: str
    #: Conditions on the item, at most one for each key.
    conditions: tuple[Condition, ...] = ()
    #: Minimum probability that all conditions hold.
    confidence: float = CONFIDENCE
    #: Its line in the file.
    line: int = 0

    def has_condition(self, key: str) -> bool:
        """Whether one of its conditions is of this key."""
        return any(condition.key == key for condition in self.conditions)

    def probability(self, evidence: Evidence) -> tuple[float, float]:
        """Return the least and the largest probability that every condition holds.

        >>> from palpate.produce.sorting.conditions import OneOf
        >>> sound = OneOf("bruised", frozenset({"false"}))
        >>> ripe = Rule(bin="shop", conditions=(OneOf("ripeness", frozenset({"ripe"})), sound))
        >>> ripe.probability(Evidence(ripeness={"ripe": 0.9, "hard": 0.1}, bruised=0.2))
        (0.72, 0.72)
        >>> ripe.probability(Evidence(ripeness={"ripe": 0.9, "hard": 0.1}))
        (0.0, 0.9)
        """
        low = high = 1.0
        for condition in self.conditions:
            known = condition.probability(evidence)
            low *= 0.0 if known is None else known
            high *= 1.0 if known is None else known
        return round(low, 12), round(high, 12)

    def describe_missing(self, evidence: Evidence) -> str:
        """Return a description of the conditions that need a missing verdict."""
        asked = (one for one in self.conditions if one.key in VERDICT_CONDITIONS)
        return next(
            (VERDICT_CONDITIONS[one.key] for one in asked if one.probability(evidence) is None), ""
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleBook:
    """All sorting rules."""

    #: Rules in order of priority.
    rules: tuple[Rule, ...]
    #: Bin of the remaining items.
    default_bin: str
    #: Maximum number of grasps of one item.
    most_grasps: int = MOST_GRASPS

    def has_condition(self, key: str) -> bool:
        """Whether any rule has a condition of this key."""
        return any(rule.has_condition(key) for rule in self.rules)

    @property
    def bins(self) -> tuple[str, ...]:
        """Every bin, the default one last."""
        return tuple(dict.fromkeys([*(rule.bin for rule in self.rules), self.default_bin]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BinDecision:
    """The bin of an item, with the reason."""

    #: The bin; the default one where no rule decides.
    bin: str
    #: Rule that applies; None for the default bin.
    rule: Rule | None
    #: Probability that all conditions of the rule hold; None for the default bin.
    probability: float | None
    #: Whether another grasp may change the decision; the bin is then provisional.
    needs_regrasp: bool
    #: The reason, for people.
    why: str


def decide(book: RuleBook, evidence: Evidence) -> BinDecision:
    """Apply the rules: the first whose conditions are probable enough wins.

    Where an earlier rule can't decide yet, or none decides, another grasp is asked for, as long as
    it can help and there are grasps left. An item unknown at its first grasp is grasped again
    too, as one bad grasp proves no untrained kind.

    `evidence`: all that is known, every grasp so far together.

    >>> from palpate.estimate.measurement import Measurement
    >>> from palpate.produce.sorting.conditions import Within
    >>> small = Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=2)
    >>> book = RuleBook(rules=(small,), default_bin="by hand", most_grasps=2)
    >>> size = Measurement(value=44.0, low=43.5, high=44.5, unit="mm")
    >>> decide(book, Evidence(size_mm=size, grasps=1)).why
    'small: 44.0 mm (43.5 to 44.5) within 0 to 45; rule in line 2 met with 100 %; 1 grasp'
    >>> size = Measurement(value=45.0, low=44.0, high=46.0, unit="mm")
    >>> decide(book, Evidence(size_mm=size, grasps=1)).needs_regrasp
    True
    """
    is_open, sure, probability = False, None, None
    for rule in book.rules:
        low, high = rule.probability(evidence)
        if low >= rule.confidence:
            sure, probability = rule, low
            break
        # A grasp measures some of what is asked. A verdict that was never given stays unknown.
        by_touch = any(condition.key not in VERDICT_CONDITIONS for condition in rule.conditions)
        is_open |= high > 1.0 - rule.confidence and by_touch and not rule.describe_missing(evidence)
    rejected = evidence.identity is not None and evidence.identity.rejected
    is_open |= evidence.grasps == 0 or (rejected and evidence.grasps < 2)
    if sure is None:
        found, why = (
            book.default_bin,
            f"{book.default_bin} (default): {_explain_no_rule(book, evidence)}",
        )
    else:
        reasons = ", ".join(condition.reason(evidence) for condition in sure.conditions)
        found, met = sure.bin, f"rule in line {sure.line} met with {percent(probability or 0.0)}"
        why = f"{sure.bin}: {reasons}; {met}"
    return BinDecision(
        bin=found,
        rule=sure,
        probability=probability,
        needs_regrasp=evidence.grasps < book.most_grasps and is_open,
        why=f"{why}; {evidence.grasps} grasp{'s' if evidence.grasps != 1 else ''}",
    )


def _explain_no_rule(book: RuleBook, evidence: Evidence) -> str:
    """Return why no rule applies: the nearest one, and its missing probability."""
    nearest = max(book.rules, key=lambda rule: rule.probability(evidence)[1])
    low, high = nearest.probability(evidence)
    # All that is known of what any rule asks for; a known kind in any case.
    has_kind = evidence.identity is not None
    names = [key for key in CONDITIONS if book.has_condition(key) or (key == "class" and has_kind)]
    known = ", ".join(filter(None, map(evidence.describe, names))) or "not measured"
    if high <= 1.0 - nearest.confidence:
        return f"{known}, which no rule takes"
    if lacking := nearest.describe_missing(evidence):
        return f"{known}; the rule in line {nearest.line} asks {lacking}, which is not known"
    return (
        f"{known}; the rule in line {nearest.line} ({nearest.bin}) comes nearest: "
        f"{percent(low)}, {percent(nearest.confidence)} needed"
    )
