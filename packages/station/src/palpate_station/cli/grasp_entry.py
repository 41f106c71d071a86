"""`palpate grasp --item`: storing the grasp of a named item."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from palpate.cli.output import print_message
from palpate.errors import StoreError
from palpate.grasp.document import GraspDocument
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.runner import Watcher
from palpate.rig import Rig
from palpate_station.cli.options import STATION_VARIABLE
from palpate_station.grasp_record import make_grasp_record
from palpate_station.records import Grasp, Item
from palpate_station.ripeness.closing import ClosingWatch
from palpate_station.store import Store
from palpate_station.store.item_history import item_facts


class StoreEntry:
    """Observes one grasp of a named item and stores the record."""

    def __init__(self, store: Store, *, item_id: str, angle_deg: float | None) -> None:
        self._store = store
        self._item_id = item_id
        self._angle_deg = angle_deg
        self._observations: list[Observation] = []
        self._closing: ClosingWatch | None = None
        self._record: tuple[Grasp, str] | None = None

    def watch(self, plan: Plan) -> Watcher:
        """Return a watcher for a grasp with this plan."""
        self._closing = ClosingWatch(plan)
        return self._closing.add_state

    def add_observation(self, observation: Observation) -> None:
        """Add the next observation."""
        self._observations.append(observation)

    def add_document(
        self, document: GraspDocument, *, rig: Rig, recording: Path | None
    ) -> GraspDocument:
        """Create the record of the grasp; return the document with its names and its item."""
        calibration = rig.calibration.as_text()
        grasp = make_grasp_record(
            document.result,
            item_id=self._item_id,
            observations=self._observations,
            layout=rig.array.layout,
            rig=rig.name,
            drive=rig.gripper.limits.drive,
            origin=rig.origin,
            calibration=calibration,
            recording=recording,
            angle_deg=self._angle_deg,
            station=os.environ.get(STATION_VARIABLE) or None,
            closing={} if self._closing is None else self._closing.list_measurements(),
        )
        self._record = grasp, calibration
        items = self._store.find_items([self._item_id])
        item = item_facts(
            self._item_id,
            kind=items[0].kind if items else None,
            verdicts=self._store.verdicts_of(self._item_id),
        )
        return replace(document, item_id=self._item_id, grasp_id=grasp.grasp_id, item=item)

    def store(self) -> bool:
        """Write the grasp to the local store and send it; return False if writing fails."""
        assert self._record is not None
        grasp, calibration = self._record
        try:
            self._store.add_grasp(grasp, calibration=calibration)
        except StoreError as error:
            print_message(f"palpate grasp: {error}: the grasp is NOT stored")
            return False
        if waiting := self._store.try_send():
            print_message(f"palpate grasp: {waiting}")
        return True


@contextmanager
def open_store_entry(
    item_id: str, *, store: str | None, angle_deg: float | None
) -> Iterator[StoreEntry]:
    """Open the local store, before the gripper moves, for one grasp of a named item.

    `store`: file or URL; None means the default store.
    `angle_deg`: rotation of the item relative to the first finger.
    Raises `InputError` if the item name is invalid; `StoreError` if the local store is unusable.
    """
    Item(item_id=item_id)
    with Store.open(store) as opened:
        yield StoreEntry(opened, item_id=item_id, angle_deg=angle_deg)
