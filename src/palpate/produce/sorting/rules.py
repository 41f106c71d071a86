"""Sorting rules: what an item must be to go to a bin, and how sure one must be of it.

A rule's conditions are each a probability, and together their product. Where a verdict that a rule
asks for was never given, all that is known is a range from 0 up: a rule answers yes, no, or that it
can't decide, and only the first rule that answers yes gets the item.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from statistics import NormalDist
from types import MappingProxyType

from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import UNKNOWN, Identity

#: Conditions that a rule may state, as they are named in a rules file.
CONDITIONS = ("class", "size_mm", "ripeness", "bruised")
#: Defaults of a rules file: a rule is sure at this probability, and grasps are tried this often.
CONFIDENCE, MOST_GRASPS = 0.8, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """Values from `low` up to, and without, `high`."""

    low: float
    high: float

    def probability(self, measured: Measurement) -> float:
        """Return the probability that a measured value is within.

        Its interval is read as of an error that is normal, with a spread of its own to each side.

        >>> size = Measurement(value=50.0, low=49.0, high=52.0, unit="mm")
        >>> Span(low=50.0, high=90.0).probability(size)
        0.5
        >>> round(Span(low=40.0, high=51.0).probability(size), 3)
        0.795
        """
        return _below(self.high, measured) - _below(self.low, measured)

    def within(self, other: Span) -> bool:
        """Whether another span holds all of this one."""
        return other.low <= self.low and self.high <= other.high

    def meets(self, other: Span) -> bool:
        """Whether the two have values in common."""
        return self.low < other.high and other.low < self.high


def _below(bound: float, measured: Measurement) -> float:
    far = NormalDist().inv_cdf(0.5 + measured.level / 2)
    side = (
        measured.value - measured.low if bound < measured.value else measured.high - measured.value
    )
    return NormalDist().cdf(far * (bound - measured.value) / max(side, 1e-9))


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """All that is known of an item when it is to be sorted."""

    #: What it is; None before anything was measured.
    identity: Identity | None = None
    #: Its size.
    size_mm: Measurement | None = None
    #: Probability of each stage that a verdict names; empty without a verdict.
    ripeness: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    #: Probability of a bruise; None without a verdict.
    bruised: float | None = None
    #: Grasps so far.
    grasps: int = 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Rule:
    """One rule; a condition that is None is not asked for."""

    #: Where the item goes.
    bin: str
    #: Kinds that it takes; may hold ``"unknown"``.
    kinds: frozenset[str] | None = None
    #: Sizes that it takes.
    size_mm: Span | None = None
    #: Stages that it takes.
    ripeness: frozenset[str] | None = None
    #: Whether it takes bruised items, or those without a bruise.
    bruised: bool | None = None
    #: How probable all of that must be together.
    confidence: float = CONFIDENCE
    #: Its line in the file.
    line: int = 0

    def probability(self, evidence: Evidence) -> tuple[float, float]:
        """Return the least and the largest probability that every condition holds.

        >>> ripe = Rule(bin="shop", ripeness=frozenset({"ripe"}), bruised=False)
        >>> ripe.probability(Evidence(ripeness={"ripe": 0.9, "hard": 0.1}, bruised=0.2))
        (0.72, 0.72)
        >>> ripe.probability(Evidence(ripeness={"ripe": 0.9, "hard": 0.1}))
        (0.0, 0.9)
        """
        low = high = 1.0
        for known in self._conditions(evidence):
            low *= 0.0 if known is None else known
            high *= 1.0 if known is None else known
        return round(low, 12), round(high, 12)

    def _conditions(self, evidence: Evidence) -> list[float | None]:
        """Return the probability of each condition that is stated; None where nothing is known."""
        found: list[float | None] = []
        if self.kinds is not None:
            found.append(_of_kinds(self.kinds, evidence.identity))
        if self.size_mm is not None:
            size = evidence.size_mm
            found.append(None if size is None else self.size_mm.probability(size))
        if self.ripeness is not None:
            stages = evidence.ripeness
            found.append(sum(stages.get(s, 0.0) for s in self.ripeness) if stages else None)
        if self.bruised is not None:
            bruise = evidence.bruised
            found.append(None if bruise is None else bruise if self.bruised else 1.0 - bruise)
        return found


def _of_kinds(kinds: frozenset[str], identity: Identity | None) -> float | None:
    if identity is None:
        return None
    if identity.rejected:
        return identity.confidence if identity.kind in kinds else 0.0
    # Short of a rejection, "something else" is a doubt and no finding.
    return sum(identity.probability.get(kind, 0.0) for kind in kinds - {UNKNOWN})


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleBook:
    """All rules, in their order."""

    #: The first that answers yes wins.
    rules: tuple[Rule, ...]
    #: Where everything else goes.
    default_bin: str
    #: Grasps of one item before it goes there.
    most_grasps: int = MOST_GRASPS

    @property
    def bins(self) -> tuple[str, ...]:
        """Every bin, the default one last."""
        named: Sequence[str] = [rule.bin for rule in self.rules]
        return tuple(dict.fromkeys([*named, self.default_bin]))
