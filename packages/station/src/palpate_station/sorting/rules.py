"""Sorting rules, and the choice of the bin with its reason.

The probability of a rule is the product of the probabilities of its conditions. If a required
verdict is missing, only a range from 0 is known. A rule therefore applies, does not apply, or is
undecided. The first rule that applies determines the bin.
"""

from __future__ import annotations

from dataclasses import dataclass

from palpate_station.sorting.conditions import (
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
    """A sorting rule: the bin of items that meet its conditions with the required confidence."""

    #: Bin of the items that meet the rule.
    bin: str
    #: Conditions on the item, at most one for each key.
    conditions: tuple[Condition, ...] = ()
    #: Minimum probability that all conditions hold.
    confidence: float = CONFIDENCE
    #: Line in the rules file.
    line: int = 0

    def has_condition(self, key: str) -> bool:
        """Return whether the rule has a condition with this key."""
        return any(condition.key == key for condition in self.conditions)

    def probability(self, evidence: Evidence) -> tuple[float, float]:
        """Return the smallest and the largest possible probability of the rule.

        >>> from palpate_station.sorting.conditions import OneOf
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
        """Return the name of the first missing verdict; empty if none is missing."""
        with_verdict = (one for one in self.conditions if one.key in VERDICT_CONDITIONS)
        missing = (one.key for one in with_verdict if one.probability(evidence) is None)
        return next((VERDICT_CONDITIONS[key] for key in missing), "")


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleBook:
    """All sorting rules."""

    #: Rules in order of priority.
    rules: tuple[Rule, ...]
    #: Bin of the remaining items.
    default_bin: str
    #: Maximum number of grasps of one item, without those that did not hold it.
    most_grasps: int = MOST_GRASPS
    #: Whether a station refuses a grasp without the name of its item.
    requires_item: bool = False

    def has_condition(self, key: str) -> bool:
        """Return whether any rule has a condition with this key."""
        return any(rule.has_condition(key) for rule in self.rules)

    @property
    def bins(self) -> tuple[str, ...]:
        """All bins, with the default bin last."""
        return tuple(dict.fromkeys([*(rule.bin for rule in self.rules), self.default_bin]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BinDecision:
    """The bin of an item, with the reason."""

    #: The bin; the default bin if no rule applies.
    bin: str
    #: Rule that applies; None for the default bin.
    rule: Rule | None
    #: Probability that all conditions of the rule hold; None for the default bin.
    probability: float | None
    #: Whether another grasp may change the decision; the bin is then provisional.
    needs_regrasp: bool
    #: What is known of the item, as text for a person who does not know the rules file.
    evidence: str
    #: How the rules apply to it, with their lines in the rules file.
    applied: str
    #: Number of grasps that the decision uses.
    grasps: int
    #: The rule that came closest and its probability, if that alone decided against it.
    closest: Rule | None = None
    closest_probability: float = 0.0

    @property
    def why(self) -> str:
        """The reason as text."""
        bin_name = self.bin if self.rule is not None else f"{self.bin} (default)"
        count = f"{self.grasps} grasp{'s' if self.grasps != 1 else ''}"
        return f"{bin_name}: {self.evidence}; {self.applied}; {count}"


def decide(book: RuleBook, evidence: Evidence) -> BinDecision:
    """Choose the bin of the first rule with sufficient probability, or the default bin.

    Another grasp is requested, up to the maximum, if the item has no grasp yet, or if a grasp can
    decide an undecided rule before the applied rule (any undecided rule if none applies). An item
    rejected as unknown after its first grasp is also grasped again, because one poor grasp does not
    prove an untrained kind.

    `evidence`: combined evidence of all grasps and verdicts.

    >>> from palpate.measurement import Measurement
    >>> from palpate_station.sorting.conditions import Within
    >>> small = Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=2)
    >>> book = RuleBook(rules=(small,), default_bin="by hand", most_grasps=2)
    >>> size = Measurement(value=44.0, low=43.5, high=44.5, unit="mm")
    >>> decide(book, Evidence(size_mm=size, grasps=1)).why
    'small: 44.0 mm (43.5 to 44.5) within 0 to 45; rule on line 2 met with 100 %; 1 grasp'
    >>> size = Measurement(value=45.0, low=44.0, high=46.0, unit="mm")
    >>> decide(book, Evidence(size_mm=size, grasps=1)).needs_regrasp
    True
    """
    is_undecided, applied, probability = False, None, None
    closest, closest_probability = None, 0.0
    for rule in book.rules:
        low, high = rule.probability(evidence)
        if low >= rule.confidence:
            applied, probability = rule, low
            break
        # Another grasp helps only if it measures a condition and no verdict is missing.
        is_measurable = any(one.key not in VERDICT_CONDITIONS for one in rule.conditions)
        is_possible = high > 1.0 - rule.confidence
        is_undecided |= is_possible and is_measurable and not rule.describe_missing(evidence)
    rejected = evidence.identity is not None and evidence.identity.rejected
    is_undecided |= evidence.grasps == 0 or (rejected and evidence.grasps < 2)
    if applied is None:
        known, met, closest, closest_probability = _explain_no_rule(book, evidence)
    else:
        known = ", ".join(condition.reason(evidence) for condition in applied.conditions)
        met = f"rule on line {applied.line} met with {percent(probability or 0.0)}"
    return BinDecision(
        bin=book.default_bin if applied is None else applied.bin,
        rule=applied,
        probability=probability,
        needs_regrasp=evidence.grasps < book.most_grasps and is_undecided,
        evidence=known,
        applied=met,
        grasps=evidence.grasps,
        closest=closest,
        closest_probability=closest_probability,
    )


def _explain_no_rule(book: RuleBook, evidence: Evidence) -> tuple[str, str, Rule | None, float]:
    """Return the evidence, and why no rule applies, with the most probable rule.

    Also return that rule and its probability, if nothing but the probability is missing.
    """
    closest = max(book.rules, key=lambda rule: rule.probability(evidence)[1])
    low, high = closest.probability(evidence)
    # The evidence for all conditions of the rules, and the kind if known.
    has_kind = evidence.identity is not None
    names = [key for key in CONDITIONS if book.has_condition(key) or (key == "class" and has_kind)]
    known = ", ".join(filter(None, map(evidence.describe, names))) or "not measured"
    if high <= 1.0 - closest.confidence:
        return known, "no rule matches", None, 0.0
    if missing := closest.describe_missing(evidence):
        return known, f"the rule on line {closest.line} requires {missing}", None, 0.0
    met = (
        f"closest rule on line {closest.line} ({closest.bin}): "
        f"{percent(low)}, {percent(closest.confidence)} required"
    )
    return known, met, closest, low
