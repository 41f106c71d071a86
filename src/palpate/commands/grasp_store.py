"""`palpate grasp --item`: what was felt goes to the store, or waits in its spool."""

from __future__ import annotations

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.grasp.belief import Observation
    from palpate.grasp.plan import Plan
    from palpate.grasp.result import GraspResult
    from palpate.grasp.runner import Watcher
    from palpate.produce.records_json import StoreRecord
    from palpate.produce.ripeness.closing import ClosingWatch
    from palpate.produce.store.outbox import Keeper
    from palpate.rig import Rig


class Memory:
    """Watches one grasp of a named item, and keeps it."""

    def __init__(self, keeper: Keeper, *, item_id: str, angle_deg: float | None) -> None:
        self._keeper = keeper
        self._item_id = item_id
        self._angle_deg = angle_deg
        self._seen: list[Observation] = []
        self._closing: ClosingWatch | None = None
        self._records: tuple[StoreRecord, ...] = ()

    def watch(self, plan: Plan) -> Watcher:
        """Return what is to watch the controller's beliefs of a grasp with this plan."""
        from palpate.produce.ripeness.closing import ClosingWatch

        self._closing = ClosingWatch(plan)
        return self._closing.see

    def see(self, observation: Observation) -> None:
        """Take the next observation."""
        self._seen.append(observation)

    def take(self, result: GraspResult, *, rig: Rig, recording: Path | None) -> dict[str, str]:
        """Take how the grasp ended; return its entry in the JSON."""
        from palpate.produce.grasp_record import records_of

        calibration, grasp = records_of(
            result,
            item_id=self._item_id,
            seen=self._seen,
            layout=rig.array.layout,
            rig=rig.name,
            drive=rig.gripper.limits.drive,
            origin=rig.origin,
            calibration=rig.calibration.as_text(),
            recording=recording,
            angle_deg=self._angle_deg,
            closing={} if self._closing is None else self._closing.measured(),
        )
        self._records = (calibration, grasp)
        return {"item_id": self._item_id, "grasp_id": grasp.grasp_id}

    def keep(self) -> bool:
        """Keep the grasp with the calibration it rests on; False where it is lost.

        A store that does not answer is waited for.
        """
        try:
            stored = self._keeper.keep(*self._records)
        except OSError as error:
            self._say(f"can't be written ({error.strerror}): the grasp is NOT kept")
            return False
        if not stored:
            self._say("has the grasp, until it is written to the store by the next that finds it")
        return True

    def _say(self, text: str) -> None:
        keeper = self._keeper
        print(f"palpate grasp: {keeper.away}; {keeper.spool.path} {text}", file=sys.stderr)


def open_memory(
    stack: ExitStack, *, item_id: str | None, store: str | None, angle_deg: float | None
) -> Memory | None:
    """Open the store before anything moves; None where no item is named.

    Raises `InputError` if the item can't be named so, or there is a store and no item; `StoreError`
    if waiting would not help the store.
    """
    if item_id is None:
        for option, value in (("--store", store), ("--angle-deg", angle_deg)):
            if value is not None:
                raise InputError(f"{option} {value}: name the item with --item NAME")
        return None
    from palpate.produce.records import Item
    from palpate.produce.store.outbox import Keeper

    Item(item_id=item_id)
    keeper = stack.enter_context(Keeper(store))
    if keeper.away is not None:
        print(f"palpate grasp: {keeper.away}. The grasp will wait for it.", file=sys.stderr)
    return Memory(keeper, item_id=item_id, angle_deg=angle_deg)
