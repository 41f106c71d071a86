"""The store: every item, grasp, measurement, verdict and calibration that was used.

The interface; its form in a database follows.
"""

from __future__ import annotations

from collections.abc import Iterable
from datetime import date, datetime, tzinfo
from pathlib import Path
from types import TracebackType
from typing import Protocol

from palpate.produce.records import About, Grasp, Item, Reading, Source, Verdict


class Store(Protocol):
    """Memory of a packhouse."""

    @classmethod
    def open(cls, where: str | Path | None = None, *, create: bool = True) -> Store:
        """Open a path, a ``sqlite:///`` or ``postgresql://`` URL; by default
        ``$PALPATE_STORE``, else ``palpate-items.sqlite`` in the current folder."""
        ...

    def add_item(self, item: Item) -> None:
        """Add an item, or fill in what is newly known of it: None leaves what is there."""
        ...

    def add_calibration(self, text: str) -> str:
        """Keep the text of a calibration file; return its id, the same for the same text."""
        ...

    def add_grasp(self, grasp: Grasp) -> bool:
        """Add a grasp with its measurements in one transaction; False if it was there already."""
        ...

    def add_grasps(self, grasps: Iterable[Grasp]) -> int:
        """Add many in one transaction; return how many were new."""
        ...

    def add_verdict(self, verdict: Verdict) -> bool:
        """Add a verdict; False if it was there already."""
        ...

    def item(self, item_id: str) -> Item:
        """Return one item; InputError if there is none of that name."""
        ...

    def items(
        self,
        *,
        kind: str | None = None,
        batch: str | None = None,
        since: datetime | None = None,
        until: datetime | None = None,
        limit: int | None = None,
    ) -> tuple[Item, ...]:
        """Return items, the last met first; `since`/`until` bound when they were first seen."""
        ...

    def grasps_of(self, item_id: str) -> tuple[Grasp, ...]:
        """Return the grasps of an item, oldest first."""
        ...

    def history(self, item_id: str, name: str) -> tuple[Reading, ...]:
        """Return one measurement of an item over its grasps, oldest first."""
        ...

    def verdicts_of(
        self, item_id: str, *, about: About | None = None, source: Source | None = None
    ) -> tuple[Verdict, ...]:
        """Return what was said of an item, oldest first."""
        ...

    def verdicts(
        self, about: About, *, source: Source | None = None, kind: str | None = None
    ) -> tuple[Verdict, ...]:
        """Return what was said of all items (of one kind), oldest first: labels to learn from."""
        ...

    def of_batch(self, batch: str) -> tuple[Item, ...]:
        """Return the items of a batch, the first met first."""
        ...

    def of_day(self, day: date, *, zone: tzinfo | None = None) -> tuple[Grasp, ...]:
        """Return the grasps of a day, oldest first; of a day in UTC unless a zone is given."""
        ...

    def close(self) -> None:
        """Let go of the database. May be called twice."""
        ...

    def __enter__(self) -> Store: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
