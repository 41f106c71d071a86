"""Sorting rules: what an item must be to go to a bin, and how sure one must be of it.

A rule's conditions are each a probability, and together their product. Where a verdict that a rule
asks for was never given, all that is known is a range from 0 up: a rule answers yes, no, or that it
can't decide, and only the first rule that answers yes gets the item.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.produce.sorting.conditions import Condition, Evidence

#: Defaults of a rules file: a rule is sure at this probability, and grasps are tried this often.
CONFIDENCE, MOST_GRASPS = 0.8, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One rule."""

    #: Where the item goes.
    bin: str
    #: All that it must be, one of a class at most.
    conditions: tuple[Condition, ...] = ()
    #: How probable all of that must be together.
    confidence: float = CONFIDENCE
    #: Its line in the file.
    line: int = 0

    def asks(self, form: type[Condition]) -> bool:
        """Whether one of its conditions is of a class."""
        return any(isinstance(condition, form) for condition in self.conditions)

    def probability(self, evidence: Evidence) -> tuple[float, float]:
        """Return the least and the largest probability that every condition holds.

        >>> from palpate.produce.sorting.conditions import BruiseIs, StageIs
        >>> ripe = Rule(bin="shop", conditions=(StageIs(frozenset({"ripe"})), BruiseIs(False)))
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

    def lacking(self, evidence: Evidence) -> str:
        """Return what it asks, in words, that only a verdict which is missing would answer."""
        return next(
            (
                one.asks
                for one in self.conditions
                if one.asks is not None and one.probability(evidence) is None
            ),
            "",
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleBook:
    """All rules, in their order."""

    #: The first that answers yes wins.
    rules: tuple[Rule, ...]
    #: Where everything else goes.
    default_bin: str
    #: Grasps of one item before it goes there.
    most_grasps: int = MOST_GRASPS

    def asks(self, form: type[Condition]) -> bool:
        """Whether any rule has a condition of a class."""
        return any(rule.asks(form) for rule in self.rules)

    @property
    def bins(self) -> tuple[str, ...]:
        """Every bin, the default one last."""
        named: Sequence[str] = [rule.bin for rule in self.rules]
        return tuple(dict.fromkeys([*named, self.default_bin]))
