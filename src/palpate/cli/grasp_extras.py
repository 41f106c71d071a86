"""`palpate grasp --damage`, `--item` and `--record`: observers of a running grasp."""

from __future__ import annotations

import math
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.cli.options import refuse_options
from palpate.cli.output import print_message
from palpate.errors import InputError, StoreError
from palpate.grasp.document import damage_limit_document
from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import Subscriber, Watcher, run_grasp
from palpate.grasp.state import GraspState
from palpate.rig import Rig
from palpate.rig.recorded import record_grasp

if TYPE_CHECKING:
    # The store is an extra; the damage model loads scipy.optimize.
    from palpate.estimate.damage_file import DamageFile
    from palpate.produce.records import Grasp
    from palpate.produce.ripeness.closing import ClosingWatch
    from palpate.produce.store import Store


class Limit:
    """The damage model of one grasp; records the limit during the closing."""

    def __init__(self, file: DamageFile, *, path: Path, kind: str) -> None:
        self.model = file.model
        self.kind = kind
        self.text = file.as_text()
        self._file = file
        self._path = path
        self._low_n = math.inf

    def add_state(self, state: GraspState) -> None:
        """Record the damage limit of the controller's next state."""
        self._low_n = state.estimate.damage_low_n

    def to_dict(self, result: GraspResult) -> dict[str, object]:
        """Return the limit and its effect, as in the JSON of the grasp."""
        return damage_limit_document(
            self._file, path=self._path, kind=self.kind, low_n=self._low_n, result=result
        )


def open_limit(path: Path | None, *, kind: str | None) -> Limit | None:
    """Load the requested damage limit; return None if no file is given.

    Raises `InputError` if a kind is given without a file, or the file lacks the kind;
    `CalibrationError` if the file is unusable.
    """
    if path is None:
        if kind is not None:
            raise InputError(f"--kind {kind}: requires --damage FILE, which defines the kinds")
        return None
    from palpate.estimate.damage_file import DamageFile

    file = DamageFile.load(path)
    known = "" if kind is None else file.check_kind(kind, where=f"--damage {path}")
    return Limit(file, path=path, kind=known)


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
        from palpate.produce.ripeness.closing import ClosingWatch

        self._closing = ClosingWatch(plan)
        return self._closing.add_state

    def add_observation(self, observation: Observation) -> None:
        """Add the next observation."""
        self._observations.append(observation)

    def add_result(
        self, result: GraspResult, *, rig: Rig, recording: Path | None
    ) -> dict[str, str]:
        """Create the record of the grasp; return its identifiers for the JSON output."""
        from palpate.produce.grasp_record import make_grasp_record

        calibration = rig.calibration.as_text()
        grasp = make_grasp_record(
            result,
            item_id=self._item_id,
            observations=self._observations,
            layout=rig.array.layout,
            rig=rig.name,
            drive=rig.gripper.limits.drive,
            origin=rig.origin,
            calibration=calibration,
            recording=recording,
            angle_deg=self._angle_deg,
            closing={} if self._closing is None else self._closing.list_measurements(),
        )
        self._record = grasp, calibration
        return {"item_id": self._item_id, "grasp_id": grasp.grasp_id}

    def item_document(self) -> dict[str, object]:
        """Return the item's record in the store, for the JSON output."""
        from palpate.produce.store.item_history import item_facts

        items = self._store.find_items([self._item_id])
        return item_facts(
            self._item_id,
            kind=items[0].kind if items else None,
            verdicts=self._store.verdicts_of(self._item_id),
        )

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


def open_store_entry(
    stack: ExitStack, *, item_id: str | None, store: str | None, angle_deg: float | None
) -> StoreEntry | None:
    """Open the local store before the gripper moves; return None without an item.

    Raises `InputError` if the item name is invalid, or a store is given without an item;
    `StoreError` if the local store is unusable.
    """
    if item_id is None:
        given = {"--store": store, "--angle-deg": angle_deg}
        refuse_options(given, why="name the item with --item NAME")
        return None
    from palpate.produce.records import Item
    from palpate.produce.store import Store

    Item(item_id=item_id)
    opened = stack.enter_context(Store.open(store))
    return StoreEntry(opened, item_id=item_id, angle_deg=angle_deg)


def run_watched(
    plan: Plan,
    *,
    rig: Rig,
    limit: Limit | None,
    entry: StoreEntry | None,
    record: Path | None,
    requests: Requests,
    stack: ExitStack,
) -> GraspResult:
    """Run a grasp with its damage limit, store entry and recording attached.

    `stack`: closes the recording after the result is printed."""
    subscribers: list[Subscriber] = []
    watchers: list[Watcher] = [] if limit is None else [limit.add_state]
    if entry is not None:
        subscribers.append(entry.add_observation)
        watchers.append(entry.watch(plan))
    recorder = None
    if record is not None:
        text = None if limit is None else limit.text
        recorder = stack.enter_context(record_grasp(record, rig=rig, plan=plan, damage=text))
        subscribers.append(recorder)
    result = run_grasp(
        plan,
        array=rig.array,
        gripper=rig.gripper,
        clock=rig.clock,
        subscribers=subscribers,
        watchers=watchers,
        requests=requests,
    )
    if recorder is not None:
        recorder.end(result)
    return result
