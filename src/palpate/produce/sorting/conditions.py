"""What a rule may ask of an item: each condition with all that the rules need of it.

A new one is a class here and an entry in `CONDITIONS`; what it asks about is a field of `Evidence`,
filled by `run.evidence_of`. Reading, deciding, explaining and finding rules that hide each other
all go through these methods.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist
from types import MappingProxyType
from typing import Any, ClassVar, Self

from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import UNKNOWN, Identity


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


class Condition:
    """One condition of a rule. Two of one class can be compared."""

    __slots__ = ()

    #: Its name in a rules file.
    key: ClassVar[str]
    #: What it asks, in words, if only an earlier verdict answers that; None if a grasp measures it.
    asks: ClassVar[str | None] = None

    @classmethod
    def read(cls, stated: Any) -> Self:
        """Return it from the value in a rules file.

        Raises `ValueError` that states what the value should be.
        """
        raise NotImplementedError

    @staticmethod
    def known(evidence: Evidence) -> str:
        """Return what is known of the item, whatever is asked; empty if it goes without saying."""
        raise NotImplementedError

    def probability(self, evidence: Evidence) -> float | None:
        """Return the probability that an item meets it; None where nothing is known."""
        raise NotImplementedError

    def reason(self, evidence: Evidence) -> str:
        """Return what shows that an item meets it."""
        return self.known(evidence)

    def covers(self, other: Self) -> bool:
        """Whether every item that meets the other meets this one."""
        raise NotImplementedError

    def common(self, other: Self) -> str | None:
        """Return what meets both, in words; None if nothing does."""
        raise NotImplementedError


@dataclass(frozen=True, slots=True)
class _OneOf(Condition):
    """Names that it takes."""

    names: frozenset[str]

    @classmethod
    def read(cls, stated: Any) -> Self:
        found = [stated] if isinstance(stated, str) else stated
        if not isinstance(found, list) or not found or not all(isinstance(n, str) for n in found):
            raise ValueError("a name or a list of names")
        return cls(frozenset(found))

    def covers(self, other: Self) -> bool:
        return other.names <= self.names

    def common(self, other: Self) -> str | None:
        both = ", ".join(sorted(self.names & other.names))
        return f"{self.key} {both}" if both else None


class KindIs(_OneOf):
    """Kinds that it takes; may hold ``"unknown"``."""

    __slots__ = ()
    key = "class"

    @staticmethod
    def known(evidence: Evidence) -> str:
        identity = evidence.identity
        if identity is None:
            return "not measured"
        if identity.rejected:
            return f"like no kind taught ({percent(identity.usual)} of those taught are as unusual)"
        ranked = sorted(identity.probability.items(), key=lambda pair: -pair[1])
        named = [
            (f"something else {percent(p)}" if kind == UNKNOWN else f"{kind} {percent(p)}")
            for kind, p in ranked[:2]
            if p >= 0.05
        ]
        return " or ".join(named)

    def probability(self, evidence: Evidence) -> float | None:
        identity = evidence.identity
        if identity is None:
            return None
        if identity.rejected:
            return identity.confidence if identity.kind in self.names else 0.0
        # Short of a rejection, "something else" is a doubt and no finding.
        return sum(identity.probability.get(kind, 0.0) for kind in self.names - {UNKNOWN})


@dataclass(frozen=True, slots=True, kw_only=True)
class SizeWithin(Condition):
    """Sizes from `low` up to, and without, `high`."""

    key = "size_mm"
    low: float
    high: float

    @classmethod
    def read(cls, stated: Any) -> Self:
        numbers = (
            isinstance(stated, list)
            and len(stated) == 2
            and all(isinstance(n, int | float) and not isinstance(n, bool) for n in stated)
        )
        if not numbers or not 0 <= stated[0] < stated[1]:
            raise ValueError("[from, to] with from < to")
        return cls(low=float(stated[0]), high=float(stated[1]))

    @staticmethod
    def known(evidence: Evidence) -> str:
        size = evidence.size_mm
        if size is None:
            return "size not measured"
        return f"{size.value:.1f} mm ({size.low:.1f} to {size.high:.1f})"

    def probability(self, evidence: Evidence) -> float | None:
        return None if evidence.size_mm is None else self.chance(evidence.size_mm)

    def chance(self, measured: Measurement) -> float:
        """Return the probability that a measured value is within.

        Its interval is read as of an error that is normal, with a spread of its own to each side.

        >>> size = Measurement(value=50.0, low=49.0, high=52.0, unit="mm")
        >>> SizeWithin(low=50.0, high=90.0).chance(size)
        0.5
        >>> round(SizeWithin(low=40.0, high=51.0).chance(size), 3)
        0.795
        """
        return _below(self.high, measured) - _below(self.low, measured)

    def reason(self, evidence: Evidence) -> str:
        return f"{self.known(evidence)} within {self.low:g} to {self.high:g}"

    def covers(self, other: Self) -> bool:
        return self.low <= other.low and other.high <= self.high

    def common(self, other: Self) -> str | None:
        low, high = max(self.low, other.low), min(self.high, other.high)
        return f"size_mm {low:g} to {high:g}" if low < high else None


class StageIs(_OneOf):
    """Stages of ripeness that it takes."""

    __slots__ = ()
    key = "ripeness"
    asks = "how ripe it is"

    @staticmethod
    def known(evidence: Evidence) -> str:
        return _likeliest(evidence.ripeness, evidence.ripeness)

    def probability(self, evidence: Evidence) -> float | None:
        stages = evidence.ripeness
        return sum(stages.get(stage, 0.0) for stage in self.names) if stages else None

    def reason(self, evidence: Evidence) -> str:
        return _likeliest(dict.fromkeys(self.names, 0.0), evidence.ripeness)


@dataclass(frozen=True, slots=True)
class BruiseIs(Condition):
    """Whether it takes bruised items, or those without a bruise."""

    key = "bruised"
    asks = "whether it is bruised"
    bruised: bool

    @classmethod
    def read(cls, stated: Any) -> Self:
        if not isinstance(stated, bool):
            raise ValueError("true or false")
        return cls(stated)

    @staticmethod
    def known(evidence: Evidence) -> str:
        return "" if evidence.bruised is None else f"bruised {percent(evidence.bruised)}"

    def probability(self, evidence: Evidence) -> float | None:
        bruise = evidence.bruised
        return None if bruise is None else bruise if self.bruised else 1.0 - bruise

    def covers(self, other: Self) -> bool:
        return self.bruised == other.bruised

    def common(self, other: Self) -> str | None:
        return "" if self.bruised == other.bruised else None


#: Conditions by their names in a rules file, in the order in which reasons are given.
CONDITIONS: Mapping[str, type[Condition]] = {
    form.key: form for form in (KindIs, SizeWithin, StageIs, BruiseIs)
}


def percent(share: float) -> str:
    """Return a share in words, small ones with two digits."""
    return f"{100 * share:.2g} %" if share < 0.01 else f"{100 * share:.0f} %"


def _likeliest(stages: Mapping[str, float], chances: Mapping[str, float]) -> str:
    """Return the likeliest of some stages with its chance; empty if there is none."""
    if not stages:
        return ""
    best = max(stages, key=lambda stage: chances.get(stage, 0.0))
    return f"{best} {percent(chances.get(best, 0.0))}"


def _below(bound: float, measured: Measurement) -> float:
    far = NormalDist().inv_cdf(0.5 + measured.level / 2)
    side = (
        measured.middle - measured.low
        if bound < measured.middle
        else measured.high - measured.middle
    )
    return NormalDist().cdf(far * (bound - measured.middle) / max(side, 1e-9))
