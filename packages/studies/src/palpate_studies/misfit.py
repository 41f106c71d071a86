"""Count the published entries that the twin does not reproduce, fitted and predicted."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from decimal import Decimal


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """One published number as printed, and the twin's range over sensors."""

    published: float
    low: float
    high: float
    #: Whether the twin was fitted to it.
    fitted: bool = False

    @property
    def is_reproduced(self) -> bool:
        """Whether the range contains a number that rounds to the printed one.

        Examples
        --------
        >>> [Entry(published=9.2, low=low, high=9.6).is_reproduced for low in (9.24, 9.3)]
        [True, False]
        """
        digits = Decimal(str(self.published)).as_tuple().exponent
        assert isinstance(digits, int)
        rounding = 0.5 * 10.0**digits
        return self.low - rounding <= self.published <= self.high + rounding


def count_missed(entries: Iterable[Entry]) -> dict[str, dict[str, int]]:
    """Count all entries and the missed entries, separately for fitted and predicted ones."""
    found = list(entries)
    return {
        name: {"entries": len(part), "missed": sum(not entry.is_reproduced for entry in part)}
        for name, fitted in (("fitted", True), ("predicted", False))
        for part in [[entry for entry in found if entry.fitted == fitted]]
    }


def format_missed(counts: dict[str, dict[str, int]], *, of: str) -> str:
    """Return the counts as a sentence.

    Examples
    --------
    >>> counts = {"fitted": {"entries": 0, "missed": 0}, "predicted": {"entries": 4, "missed": 1}}
    >>> format_missed(counts, of="Table 4")
    "Entries of Table 4 outside the twin's range: 1 of 4 predicted."
    """
    parts = [
        f"{count['missed']} of {count['entries']} {name}"
        for name, count in counts.items()
        if count["entries"]
    ]
    return f"Entries of {of} outside the twin's range: {', '.join(parts)}."
