"""How well a crate was sorted: purity of each bin, and items per hour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.estimate.measurement import Measurement
from palpate.produce.identify.identifier import label_identity
from palpate.produce.learning import UNKNOWN
from palpate.produce.sorting.conditions import Evidence
from palpate.produce.sorting.rules import RuleBook, decide

#: Assumed in items per hour, as no grasp measures it: handling an item and carrying
#: it to its bin, and turning it for another grasp.
CARRY_S, TURN_S = 4.0, 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """One item that went to a bin."""

    #: Where it went.
    bin: str
    #: Where it belongs; None where unknown.
    belongs: str | None
    #: How often it was grasped.
    grasps: int
    #: Time in the hand.
    grasping_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """A crate that was sorted."""

    #: In all.
    items: int
    #: Fraction that went to the default bin.
    left_over: float
    #: Of what went to a bin by a rule and whose place is known, the fraction that belongs there.
    purity: float | None
    #: Items in each bin, and how many of them belong there.
    bins: dict[str, tuple[int, int]]
    #: `CARRY_S` and `TURN_S` included; they are assumed, not measured.
    grasps_per_item: float
    items_per_hour: float


def score_sorting(placed: Sequence[Placed], *, book: RuleBook) -> Score:
    """Return how well a crate was sorted.

    Raises `ValueError` if there is no item.

    >>> from palpate.produce.sorting.rules import Rule
    >>> book = RuleBook(rules=(Rule(bin="kiwi"),), default_bin="by hand")
    >>> done = [Placed(bin="kiwi", belongs=b, grasps=1, grasping_s=14.0) for b in ("kiwi", "egg")]
    >>> found = score_sorting(done, book=book)
    >>> found.purity, found.items_per_hour
    (0.5, 200.0)
    """
    if not placed:
        raise ValueError("there is no sorted item to score")
    by_rule = [one for one in placed if one.bin != book.default_bin]
    known = [one for one in by_rule if one.belongs is not None]
    bins = {
        name: (
            sum(one.bin == name for one in placed),
            sum(one.bin == name == one.belongs for one in placed),
        )
        for name in book.bins
    }
    busy_s = sum(one.grasping_s + CARRY_S + TURN_S * max(one.grasps - 1, 0) for one in placed)
    return Score(
        items=len(placed),
        left_over=1.0 - len(by_rule) / len(placed),
        purity=sum(o.bin == o.belongs for o in known) / len(known) if known else None,
        bins={name: counts for name, counts in bins.items() if counts[0]},
        grasps_per_item=sum(one.grasps for one in placed) / len(placed),
        items_per_hour=3600.0 * len(placed) / busy_s,
    )


def find_true_bin(book: RuleBook, *, kind: str, is_trained: bool, size_mm: float) -> str:
    """Return the bin of a fully known item, without ripeness and bruises.

    >>> from palpate.produce.sorting.conditions import OneOf
    >>> from palpate.produce.sorting.rules import Rule
    >>> eggs = Rule(bin="a", conditions=(OneOf("class", frozenset({"egg"})),))
    >>> book = RuleBook(rules=(eggs,), default_bin="rest")
    >>> find_true_bin(book, kind="egg", is_trained=True, size_mm=44.0)
    'a'
    """
    identity = label_identity(kind if is_trained else UNKNOWN)
    size = Measurement(value=size_mm, low=size_mm, high=size_mm, unit="mm")
    known = Evidence(identity=identity, size_mm=size, grasps=book.most_grasps)
    return decide(book, known).bin
