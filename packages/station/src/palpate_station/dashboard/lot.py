"""The items of a lot by bin, and its packout."""

from __future__ import annotations

from collections import Counter

from palpate.grasp.document import GraspDocument
from palpate.grasp.result import Outcome


class Lot:
    """Counts the items of a batch; an item counts once, with the bin of its last grasp.

    An item whose bin is provisional does not count before its last grasp.

    Parameters
    ----------
    name : str
        Name of the batch; empty if it has none.
    default_bin : str, optional
        The bin of the items that no rule accepts: the others are the packout.

    Examples
    --------
    >>> from palpate.grasp.document import Bin
    >>> from palpate.grasp.result import GraspResult
    >>> lot, held = Lot("Monday", default_bin="by hand"), GraspResult(outcome=Outcome.HELD)
    >>> for item, name in (("A1", "large"), ("A2", "by hand"), ("A1", "large"), ("A3", "large")):
    ...     lot.add(GraspDocument(result=held, item_id=item, bin=Bin(name=name)))
    >>> lot.items, dict(lot.bins), round(lot.packout_percent)
    (3, {'large': 2, 'by hand': 1}, 67)
    """

    def __init__(self, name: str = "", *, default_bin: str | None = None) -> None:
        self.name, self._default_bin = name, default_bin
        #: Bin of each item; empty without rules.
        self._bin_of = dict[str, str]()

    def add(self, document: GraspDocument) -> None:
        """Count the item of a finished grasp."""
        if document.result.outcome is not Outcome.HELD or document.needs_regrasp:
            return
        if document.bin is None and self._default_bin is not None:
            return
        # An unnamed item is known by its recording.
        self._bin_of[document.item_id or document.recording] = document.bin_name

    @property
    def items(self) -> int:
        """Number of items."""
        return len(self._bin_of)

    @property
    def bins(self) -> Counter[str]:
        """Number of items by bin; empty without rules."""
        return Counter(name for name in self._bin_of.values() if name)

    @property
    def packout_percent(self) -> float | None:
        """Percentage of items outside of the default bin; None without items or rules."""
        bins = self.bins
        if not bins or self._default_bin is None:
            return None
        return 100.0 * (1.0 - bins[self._default_bin] / bins.total())
