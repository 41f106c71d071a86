"""The bin of a measured item, decided once, while the hand holds the item."""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.grasp.document import Bin, GraspDocument, ItemFacts
from palpate.grasp.result import Outcome
from palpate_station.records import Grasp, Verdict
from palpate_station.sorting.run import Sorted


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """What a station knows and decides about a grasp, from the answer on.

    Attributes
    ----------
    grasp : Grasp
        The record for the store.
    item : ItemFacts or None
        What the store knows of the item; None without a name.
    is_sorted : bool
        Whether there are sorting rules.
    done : Sorted or None
        The decision from all grasps of the item; None without rules, or with an unreadable store.
    no_bin : str
        Why there is no decision.
    away : str
        Why grasps of other stations may be missing.
    batch : str or None
        The batch of the item; empty if it was grasped before without one, None if never.
    sorted_as : str
        The final bin that the item already had before this grasp; empty if it had none.
    given : Verdict or None
        The bin that a person has given to the item, which no grasp changes.
    """

    grasp: Grasp
    item: ItemFacts | None = None
    is_sorted: bool = False
    done: Sorted | None = None
    no_bin: str = ""
    away: str = ""
    batch: str | None = None
    sorted_as: str = ""
    given: Verdict | None = None

    @property
    def bin(self) -> Bin | None:
        """The bin, if a person or the rules decided."""
        if self.given is not None:
            measured = "" if self.done is None else f", measured: {self.done.decision.why}"
            why = f"{self.given.text}: given by {self.given.giver}{measured}"
            return Bin(name=self.given.text, rule=None, probability=None, again=False, why=why)
        if self.done is None:
            return None
        decision = self.done.decision
        before = self.sorted_as and f"measured again, already sorted: {self.sorted_as}"
        notes = "; ".join(filter(None, (before, self.away)))
        return Bin(
            name=decision.bin,
            rule=None if decision.rule is None else decision.rule.line,
            probability=decision.probability,
            # Grasps without a name are not combined, so another one would not help.
            again=decision.needs_regrasp and self.item is not None,
            why=f"{decision.why} ({notes})" if notes else decision.why,
        )

    @property
    def evidence(self) -> str:
        """What the bin is based on, as text; empty without a decision."""
        return "" if self.done is None else self.done.decision.evidence

    def complete(self, document: GraspDocument) -> GraspDocument:
        """Return the document with its item, and with the bin if the item was held to the end."""
        is_held = document.result.outcome is Outcome.HELD
        return replace(
            document,
            item=self.item,
            is_sorted=self.is_sorted,
            bin=self.bin if is_held else None,
            no_bin=self.no_bin if is_held and self.bin is None else "",
        )
