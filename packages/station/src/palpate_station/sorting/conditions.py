"""Conditions of a sorting rule, and the evidence on an item.

A condition requires one of several names (kind, stage, bruise) or a value within a range (size,
firmness). To add a condition, add a row to `CONDITIONS` and a field to `Evidence`, and fill the
field in `run.combine_evidence`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, TypeAlias

from palpate.measurement import Measurement
from palpate_station.identify.identifier import Identity
from palpate_station.learning import UNKNOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The evidence on an item when it is sorted."""

    #: Kind of the item; None before the first measurement.
    identity: Identity | None = None
    #: Why no kind can be identified, so that no condition on the class can be met; else empty.
    class_fault: str = ""
    #: Size, and firmness from 0 to 100.
    size_mm: Measurement | None = None
    firmness: Measurement | None = None
    #: Probability of each stage in the verdict; empty without a verdict.
    ripeness: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    #: Probability of a bruise; None without a verdict.
    bruised: float | None = None
    #: Number of grasps so far that held the item to the end.
    grasps: int = 0

    def probabilities(self, key: str) -> Mapping[str, float]:
        """Return the probability of each name for a condition key; empty if unknown."""
        if key == "ripeness":
            return self.ripeness
        if key == "bruised":
            return {} if self.bruised is None else {"true": self.bruised, "false": 1 - self.bruised}
        if self.identity is None:
            return {}
        if self.identity.rejected:
            return {UNKNOWN: self.identity.confidence}
        # Only a rejection makes an item unknown.
        return {kind: p for kind, p in self.identity.probability.items() if kind != UNKNOWN}

    def describe(self, key: str) -> str:
        """Return the evidence for a condition key as text; empty without a verdict."""
        if key == "class":
            if self.identity is not None:
                return _describe_kind(self.identity)
            return f"class unknown: {self.class_fault}" if self.class_fault else "not measured"
        if key == "bruised":
            return "" if self.bruised is None else f"bruised {percent(self.bruised)}"
        if key == "ripeness":
            return _most_probable_text(self.ripeness)
        known: Measurement | None = getattr(self, key)
        if known is None:
            return f"{key.removesuffix('_mm')} not measured"
        digits = 1 if key == "size_mm" else 0
        value, low, high = (f"{end:.{digits}f}" for end in (known.middle, known.low, known.high))
        return f"{f'{value} mm' if key == 'size_mm' else f'{key} {value}'} ({low} to {high})"


@dataclass(frozen=True, slots=True)
class OneOf:
    """Accepted names: kinds (including ``"unknown"``), stages, or ``"true"`` for bruised."""

    key: str
    names: frozenset[str]

    def probability(self, evidence: Evidence) -> float | None:
        """Return the probability that an item has one of the names; None if unknown."""
        if self.key == "class" and evidence.class_fault:
            return 0.0
        known = evidence.probabilities(self.key)
        return sum(known.get(name, 0.0) for name in self.names) if known else None

    def reason(self, evidence: Evidence) -> str:
        """Return the evidence for one of the names as text."""
        if self.key != "ripeness":
            return evidence.describe(self.key)
        return _most_probable_text({name: evidence.ripeness.get(name, 0.0) for name in self.names})

    def covers(self, other: OneOf | Within) -> bool:
        """Return whether this condition accepts every item that the other accepts."""
        return isinstance(other, OneOf) and other.names <= self.names

    def describe_overlap(self, other: OneOf | Within) -> str | None:
        """Return the overlap with another condition as text; None without overlap."""
        both = sorted(self.names & other.names) if isinstance(other, OneOf) else []
        return f"{self.key} {', '.join(both)}" if both else None


@dataclass(frozen=True, slots=True)
class Within:
    """Accepted values: from `low` (included) to `high` (excluded)."""

    key: str
    low: float
    high: float

    def probability(self, evidence: Evidence) -> float | None:
        """Return the probability that the item's value is in the range; None if not measured.

        The error distribution is assumed normal, with a separate spread on each side.

        >>> size = Measurement(value=50.0, low=49.0, high=52.0, unit="mm")
        >>> Within("size_mm", 50.0, 90.0).probability(Evidence(size_mm=size))
        0.5
        >>> round(Within("size_mm", 40.0, 51.0).probability(Evidence(size_mm=size)), 3)
        0.795
        """
        measured: Measurement | None = getattr(evidence, self.key)
        return (
            None
            if measured is None
            else measured.probability_below(self.high) - measured.probability_below(self.low)
        )

    def reason(self, evidence: Evidence) -> str:
        """Return the measured value and the range as text."""
        return f"{evidence.describe(self.key)} within {self.low:g} to {self.high:g}"

    def covers(self, other: OneOf | Within) -> bool:
        """Return whether this condition accepts every item that the other accepts."""
        return isinstance(other, Within) and self.low <= other.low and other.high <= self.high

    def describe_overlap(self, other: OneOf | Within) -> str | None:
        """Return the overlap with another condition as text; None without overlap."""
        if not isinstance(other, Within):
            return None
        low, high = max(self.low, other.low), min(self.high, other.high)
        return f"{self.key} {low:g} to {high:g}" if low < high else None


#: Largest value of the firmness index.
FIRMNESS_END = 100.0
Condition: TypeAlias = OneOf | Within


def _read_names(key: str, stated: Any) -> OneOf:
    found = [stated] if isinstance(stated, str) else stated
    if not isinstance(found, list) or not found or not all(isinstance(n, str) for n in found):
        raise ValueError("a name or a list of names")
    return OneOf(key, frozenset(found))


def _read_range(key: str, stated: Any) -> Within:
    numbers = (
        isinstance(stated, list)
        and len(stated) == 2
        and all(isinstance(n, int | float) and not isinstance(n, bool) for n in stated)
    )
    most, end = (FIRMNESS_END, f" <= {FIRMNESS_END:g}") if key == "firmness" else (math.inf, "")
    if not numbers or not 0 <= stated[0] < stated[1] <= most:
        raise ValueError(f"[from, to] with 0 <= from < to{end}")
    return Within(key, float(stated[0]), float(stated[1]))


def _read_truth(key: str, stated: Any) -> OneOf:
    if not isinstance(stated, bool):
        raise ValueError("true or false")
    return OneOf(key, frozenset({"true" if stated else "false"}))


#: Name of a condition in a rules file -> reader of its value, in the order of the reasons. A reader
#: raises `ValueError` with the expected form.
CONDITIONS: Mapping[str, Callable[[str, Any], Condition]] = {
    "class": _read_names,
    "size_mm": _read_range,
    "firmness": _read_range,
    "ripeness": _read_names,
    "bruised": _read_truth,
}
#: Conditions that require a stored verdict, with the name of the verdict.
VERDICT_CONDITIONS = {"ripeness": "a ripeness verdict", "bruised": "a bruise verdict"}


def percent(fraction: float) -> str:
    """Return a fraction as text in percent, with two significant digits below 1 %."""
    return f"{100 * fraction:.2g} %" if fraction < 0.01 else f"{100 * fraction:.0f} %"


def _describe_kind(identity: Identity) -> str:
    if identity.rejected:
        usual = f"{percent(identity.usual)} of training items are at least as atypical"
        return f"unlike every labelled kind ({usual})"
    return " or ".join(f"{kind} {percent(p)}" for kind, p in identity.rank_kinds(2, least=0.05))


def _most_probable_text(probabilities: Mapping[str, float]) -> str:
    best = max(probabilities, key=lambda name: probabilities[name], default=None)
    return "" if best is None else f"{best} {percent(probabilities[best])}"
