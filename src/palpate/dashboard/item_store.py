"""Items and their history on the page: grasps of a named item go to the store, its past comes back.

The store is opened for each look and each grasp: it may be away, and others use it too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from palpate.errors import InputError, PalpateError, StoreError
from palpate.estimate.measurement import Measurement
from palpate.grasp.belief import Observation
from palpate.grasp.result import GraspResult
from palpate.recording import RecordingReader
from palpate.recording.replay import observations

if TYPE_CHECKING:
    from palpate.produce.records import Grasp
    from palpate.produce.sorting.decide import BinDecision
    from palpate.produce.sorting.rules import RuleBook
    from palpate.produce.store import Store
    from palpate.produce.store.item_history import ItemHistory
    from palpate.produce.store.sender import Sender

_Read = TypeVar("_Read")
MISSING = "items need the store: pip install 'palpate[produce]'"


class ItemStore:
    """Reads and writes a store of items.

    Parameters
    ----------
    where : str or None
        As `palpate.produce.store.Store.open` takes it.
    rules : RuleBook or None
        Sorting rules, which give each item its bin.
    """

    def __init__(self, where: str | None, *, rules: RuleBook | None = None) -> None:
        self._where, self._rules = where, rules
        self._sender: Sender | None = None
        #: Why the last record did not reach the store; empty if it did.
        self.trouble = "" if find_spec("sqlalchemy") else MISSING

    def keep(
        self,
        result: GraspResult,
        *,
        recording: Path,
        item_id: str,
        closing: Mapping[str, Measurement],
    ) -> None:
        """Write a recorded grasp to the local store, which a shared one is sent from.

        `closing` holds the measurements of the whole closing, as `ClosingWatch.measured` gives it.
        """
        if self.trouble == MISSING:
            return
        from palpate.produce.store import Store
        from palpate.produce.store.sender import Sender

        try:
            grasp, calibration = _read_grasp(
                result, recording=recording, item_id=item_id, closing=closing
            )
            with Store.open(self._where) as store:
                store.add_grasp(grasp, calibration=calibration)
        except (PalpateError, OSError) as error:
            self.trouble = str(error)
            return
        self.trouble = ""
        if self._sender is None:
            self._sender = Sender(self._where)
        self._sender.wake()

    def sort(self, item_id: str) -> BinDecision | None:
        """Return which bin an item goes to, by all its grasps; None without rules.

        Raises
        ------
        PalpateError
            If the store can't be used, or too little was taught for the rules.
        """
        if self._rules is None or self.trouble == MISSING:
            return None
        from palpate.produce.identify.items import learn_kinds
        from palpate.produce.sorting.conditions import KindIs
        from palpate.produce.sorting.decide import decide
        from palpate.produce.sorting.run import evidence_of
        from palpate.produce.store import Store

        with Store.open(self._where, create=False) as store:
            kind = store.item(item_id).kind
            guess = kind is None and self._rules.asks(KindIs)
            evidence = evidence_of(
                store.grasps_of(item_id),
                identifier=learn_kinds(store, without=item_id) if guess else None,
                kind=kind,
                verdicts=store.verdicts_of(item_id),
            )
            away = store.away
        decision = decide(self._rules, evidence)
        return decision if away is None else replace(decision, why=f"{decision.why} ({away})")

    def items(self, *, limit: int = 200) -> list[str]:
        """Return the names of items, the last met first; none where there is no store yet.

        Raises
        ------
        PalpateError
            If the store can't be used, or does not answer.
        """
        return self._read(lambda store: [i.item_id for i in store.items(limit=limit)]) or []

    def pages(self, *, limit: int) -> tuple[ItemHistory, ...]:
        """Return the pages of items, the last met first; none where there is no store yet.

        Raises
        ------
        PalpateError
            If the store can't be used, or does not answer.
        """
        from palpate.produce.store.item_history import item_pages

        return self._read(lambda store: item_pages(store, store.items(limit=limit))) or ()

    def page(self, item_id: str) -> ItemHistory:
        """Return the history of an item.

        Raises
        ------
        PalpateError
            If there is no such item, or the store can't be used.
        """
        from palpate.produce.store.item_history import item_page

        found = self._read(lambda store: item_page(store, item_id))
        if found is None:
            raise InputError(f"no item {item_id!r}: the store is empty")
        return found

    def _read(self, read: Callable[[Store], _Read]) -> _Read | None:
        """Read from the store; None where there is none yet."""
        if self.trouble == MISSING:
            return None
        from palpate.produce.store import Store

        try:
            store = Store.open(self._where, create=False)
        except StoreError as error:
            if "no such file" in str(error):
                return None
            raise
        with store:
            return read(store)


def _read_grasp(
    result: GraspResult, *, recording: Path, item_id: str, closing: Mapping[str, Measurement]
) -> tuple[Grasp, str]:
    """Return the record of a grasp, and the text of its calibration."""
    from palpate.produce.grasp_record import make_grasp_record

    with RecordingReader(recording) as reader:
        info = reader.info
        seen = [
            Observation(frame=frame, gripper=state)
            for frame, state in observations(reader)
            if state is not None
        ]
    grasp = make_grasp_record(
        result,
        item_id=item_id,
        seen=seen,
        layout=info.layout,
        rig=info.rig or "",
        drive="width" if info.gripper is None else info.gripper.drive,
        origin=info.origin,
        calibration=info.calibration or "",
        recording=recording,
        closing=closing,
    )
    return grasp, info.calibration or ""
