"""What a benchmark gives back.

A benchmark is a file with a function `measure(full)`, which takes whether to measure the full sizes
and returns `Measured`, and a row in `palpate_studies.catalogue`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from statistics import median
from typing import Any


@dataclass(frozen=True, slots=True, kw_only=True)
class Ratio:
    """One piece of work, by palpate and by a peer in the same run; less is better."""

    #: What is done, and how much of it.
    what: str
    size: int
    of: str
    peer: str
    #: What it took, in `unit`; None of a peer that is not installed.
    ours: float
    theirs: float | None
    unit: str = "s"
    #: How many times as good as the peer it must be; None where the peer is only for comparison.
    wanted: float | None = None
    #: Remedy where the peer is not installed.
    install: str = ""

    @property
    def times(self) -> float | None:
        """Return how many times as good as the peer palpate is."""
        return None if self.theirs is None else self.theirs / self.ours

    @property
    def missed(self) -> bool:
        """Return whether it is measurably less than wanted."""
        return self.times is not None and self.wanted is not None and self.times < self.wanted

    def to_dict(self) -> dict[str, Any]:
        """Return the fields and what follows from them."""
        return asdict(self) | {"times": self.times, "missed": self.missed}


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The outcome of one benchmark."""

    ratios: Sequence[Ratio]
    #: What is simulated, what was scaled, and what else must be known to read the figures.
    notes: Sequence[str] = ()


def side_by_side_s(*acts: Callable[[], object], repeats: int) -> list[float]:
    """Return the median processor time of each act, s.

    They take turns, so that a machine that is busy for a while is busy for all of them.
    """
    taken: list[list[float]] = [[] for _ in acts]
    for _ in range(repeats):
        for act, times in zip(acts, taken, strict=True):
            started_s = time.process_time()
            act()
            times.append(time.process_time() - started_s)
    return [median(times) for times in taken]
