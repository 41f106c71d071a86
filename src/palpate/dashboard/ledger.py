"""Items and their history on the page: grasps of a named item go to the store, its past comes back.

The store is opened for each look and each grasp: it may be away, and others use it too.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec

from palpate.dashboard.messages import Grasped, Source
from palpate.errors import PalpateError

MISSING = "items need the store: pip install 'palpate[produce]'"


@dataclass(frozen=True, slots=True, kw_only=True)
class Past:
    """One measurement of an item at one time, with its interval."""

    taken_at: datetime
    value: float
    low: float
    high: float
    simulated: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class ItemPage:
    """What is known of an item.

    Attributes
    ----------
    item_id, kind, batch
        As the store has them.
    first_seen : datetime or None
        When it was met first.
    grasps : int
        How many there are.
    stiffness : tuple of Past
        Stiffness over time, N/mm, oldest first.
    settled : tuple of Past
        Settled change over time, percent, oldest first.
    verdicts : tuple of (datetime, str, str, str)
        When, about what, what was said, and why; newest first.
    """

    item_id: str
    kind: str | None
    batch: str | None
    first_seen: datetime | None
    grasps: int
    stiffness: tuple[Past, ...]
    settled: tuple[Past, ...]
    verdicts: tuple[tuple[datetime, str, str, str], ...]


class Ledger:
    """Reads and writes a store of items.

    Parameters
    ----------
    where : str or None
        As `palpate.produce.store.Store.open` takes it.

    Attributes
    ----------
    trouble : str
        Why the last record did not reach the store; empty if it did.
    """

    def __init__(self, where: str | None) -> None:
        self._where = where
        self.trouble = "" if find_spec("sqlalchemy") else MISSING

    def keep(self, grasped: Grasped, *, source: Source, item_id: str) -> None:
        """Write a grasp to the store; while that is away, to its spool."""
        if self.trouble == MISSING:
            return
        from palpate.produce.keeping import Keeper
        from palpate.produce.records import MEASURED, Grasp

        result = grasped.result
        measured = {name: getattr(result, name) for name in MEASURED}
        try:
            record = Grasp(
                item_id=item_id,
                taken_at=datetime.now(UTC),
                rig=source.name,
                drive="width" if source.gripper is None else source.gripper.drive,
                origin=source.origin,
                outcome=result.outcome,
                measurements={name: one for name, one in measured.items() if one is not None},
                decision_time_s=result.decision_time_s,
                peak_force_n=result.peak_force_n,
                recording=None if grasped.recording is None else str(grasped.recording),
            )
            with Keeper(self._where) as keeper:
                kept = keeper.keep(record)
                self.trouble = "" if kept else f"waits in {keeper.spool.path}: {keeper.away}"
        except (PalpateError, OSError) as error:
            self.trouble = str(error)

    def items(self, *, limit: int = 200) -> list[str]:
        """Return the names of items, the last met first; none where there is no store yet.

        Raises
        ------
        PalpateError
            If the store can't be used, or does not answer.
        """
        if self.trouble == MISSING:
            return []
        from palpate.errors import StoreError
        from palpate.produce.store import Store

        try:
            with Store.open(self._where, create=False) as store:
                return [item.item_id for item in store.items(limit=limit)]
        except StoreError as error:
            if "no such file" in str(error):
                return []
            raise

    def page(self, item_id: str) -> ItemPage:
        """Return what is known of an item.

        Raises
        ------
        PalpateError
            If there is no such item, or the store can't be used.
        """
        from palpate.produce.store import Store

        with Store.open(self._where, create=False) as store:
            item, grasps = store.item(item_id), store.grasps_of(item_id)
            histories = {
                name: tuple(
                    Past(
                        taken_at=reading.taken_at,
                        value=reading.measurement.value,
                        low=reading.measurement.low,
                        high=reading.measurement.high,
                        simulated=reading.origin != "hardware",
                    )
                    for reading in store.history(item_id, name)
                )
                for name in ("stiffness_n_per_mm", "settled_percent")
            }
            said = store.verdicts_of(item_id)
        return ItemPage(
            item_id=item.item_id,
            kind=item.kind,
            batch=item.batch,
            first_seen=item.first_seen,
            grasps=len(grasps),
            stiffness=histories["stiffness_n_per_mm"],
            settled=histories["settled_percent"],
            verdicts=tuple(
                (one.given_at, str(one.about), one.text, one.explanation) for one in reversed(said)
            ),
        )
