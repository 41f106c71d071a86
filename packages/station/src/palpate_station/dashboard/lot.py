"""The items of a lot by bin, and its packout."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from types import MappingProxyType

from palpate_station.dashboard.words import Words

#: Bin and time of each item whose bin a person has given.
GivenBins = Mapping[str, tuple[str, str]]
_NO_BINS: GivenBins = MappingProxyType({})


class Lot:
    """Counts the items of a batch; an item counts once, with the bin of its last grasp.

    Parameters
    ----------
    name : str
        Name of the batch; empty if it has none.
    default_bin : str, optional
        The bin of the items that no rule accepts: the others are the packout.
    given : mapping
        The bins that people have given; they replace those of the grasps.

    Examples
    --------
    >>> lot = Lot("Monday", default_bin="by hand")
    >>> for item, name in (("A1", "large"), ("A2", "by hand"), ("A1", "large"), ("A3", "large")):
    ...     lot.add(item, bin_name=name)
    >>> lot.items, dict(lot.bins), round(lot.packout_percent)
    (3, {'large': 2, 'by hand': 1}, 67)
    """

    def __init__(
        self, name: str = "", *, default_bin: str | None = None, given: GivenBins = _NO_BINS
    ) -> None:
        self.name, self._default_bin, self._given = name, default_bin, given
        #: Bin of each item; empty without rules, None while it is provisional.
        self._bin_of = dict[str, str | None]()

    def add(self, item: str, *, bin_name: str | None) -> None:
        """Add an item with its bin: empty without rules, None to count only a person's bin."""
        self._bin_of[item] = bin_name

    def discard(self, item: str) -> None:
        """Do not count an item, such as one of another batch."""
        self._bin_of.pop(item, None)

    def _final_bins(self) -> list[str]:
        found = (self._given.get(item, (name,))[0] for item, name in self._bin_of.items())
        return [name for name in found if name is not None]

    @property
    def items(self) -> int:
        """Number of items with a final bin, or of all without rules."""
        return len(self._final_bins())

    @property
    def bins(self) -> Counter[str]:
        """Number of items by bin; empty without rules."""
        return Counter(name for name in self._final_bins() if name)

    @property
    def packout_percent(self) -> float | None:
        """Percentage of items outside of the default bin; None without items or rules."""
        bins = self.bins
        if not bins or self._default_bin is None:
            return None
        return 100.0 * (1.0 - bins[self._default_bin] / bins.total())


def lot_text(lot: Lot, words: Words) -> str:
    """Return the line of a lot: name, number of items, bins and packout.

    It is empty for a lot without name and items.
    """
    if not (lot.name or lot.items):
        return ""
    texts = [words("lot", name=lot.name) if lot.name else words("lot.unnamed")]
    texts.append(words("lot.items", n=lot.items))
    texts += [f"{name} {count}" for name, count in lot.bins.most_common()]
    if lot.packout_percent is not None:
        texts.append(words("lot.packout", percent=f"{lot.packout_percent:.0f}"))
    return " · ".join(texts)
