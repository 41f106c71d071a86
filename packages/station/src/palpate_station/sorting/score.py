"""Score of a sorted crate: purity of the bins, and items per hour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from palpate.measurement import Measurement
from palpate_station.identify.identifier import label_identity
from palpate_station.learning import UNKNOWN
from palpate_station.sorting.conditions import Evidence
from palpate_station.sorting.rules import RuleBook, decide

#: Assumed times, seconds, because no grasp measures them: handling of an item until it is in its
#: bin, and a turn for another grasp.
CARRY_S, TURN_S = 4.0, 1.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A sorted item."""

    #: Bin that the item was put in.
    bin: str
    #: Correct bin; None if unknown.
    true_bin: str | None
    #: Number of grasps.
    grasps: int
    #: Total duration of the grasps.
    grasping_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Score:
    """Score of a sorted crate."""

    #: Total number of items.
    items: int
    #: Fraction in the default bin.
    left_over: float
    #: Fraction in the correct bin, of the items sorted by a rule whose correct bin is known.
    purity: float | None
    #: For each bin with items: number of items, and number of these for which it is correct.
    bins: dict[str, tuple[int, int]]
    grasps_per_item: float
    #: Includes the assumed times `CARRY_S` and `TURN_S`.
    items_per_hour: float


def score_sorting(placed: Sequence[Placed], *, book: RuleBook) -> Score:
    """Return the score of a sorted crate.

    Raises `ValueError` if there is no item.

    >>> from palpate_station.sorting.rules import Rule
    >>> book = RuleBook(rules=(Rule(bin="kiwi"),), default_bin="by hand")
    >>> done = [Placed(bin="kiwi", true_bin=b, grasps=1, grasping_s=14.0) for b in ("kiwi", "egg")]
    >>> found = score_sorting(done, book=book)
    >>> found.purity, found.items_per_hour
    (0.5, 200.0)
    """
    if not placed:
        raise ValueError("there are no sorted items to score")
    by_rule = [one for one in placed if one.bin != book.default_bin]
    known = [one for one in by_rule if one.true_bin is not None]
    bins = {
        name: (
            sum(one.bin == name for one in placed),
            sum(one.bin == name == one.true_bin for one in placed),
        )
        for name in book.bins
    }
    busy_s = sum(one.grasping_s + CARRY_S + TURN_S * max(one.grasps - 1, 0) for one in placed)
    return Score(
        items=len(placed),
        left_over=1.0 - len(by_rule) / len(placed),
        purity=sum(o.bin == o.true_bin for o in known) / len(known) if known else None,
        bins={name: counts for name, counts in bins.items() if counts[0]},
        grasps_per_item=sum(one.grasps for one in placed) / len(placed),
        items_per_hour=3600.0 * len(placed) / busy_s,
    )


def find_true_bin(book: RuleBook, *, kind: str, is_trained: bool, size_mm: float) -> str:
    """Return the bin of an item with known kind and size, without verdicts.

    >>> from palpate_station.sorting.conditions import OneOf
    >>> from palpate_station.sorting.rules import Rule
    >>> eggs = Rule(bin="a", conditions=(OneOf("class", frozenset({"egg"})),))
    >>> book = RuleBook(rules=(eggs,), default_bin="rest")
    >>> find_true_bin(book, kind="egg", is_trained=True, size_mm=44.0)
    'a'
    """
    identity = label_identity(kind if is_trained else UNKNOWN)
    size = Measurement(value=size_mm, low=size_mm, high=size_mm, unit="mm")
    known = Evidence(identity=identity, size_mm=size, grasps=book.most_grasps)
    return decide(book, known).bin
