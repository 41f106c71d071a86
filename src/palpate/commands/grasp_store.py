"""`palpate grasp --item`: what was felt goes to the store, or waits in its spool."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.grasp.belief import Observation
    from palpate.grasp.result import GraspResult
    from palpate.produce.keeping import Keeper
    from palpate.rig import Rig


def open_keeper(
    stack: ExitStack, *, item_id: str | None, store: str | None, angle_deg: float | None
) -> Keeper | None:
    """Open the store before anything moves; None where no item is named.

    Raises
    ------
    InputError
        If the item can't be named so, or there is a store and no item.
    StoreError
        If waiting would not mend the store.
    """
    if item_id is None:
        for option, value in (("--store", store), ("--angle-deg", angle_deg)):
            if value is not None:
                raise InputError(f"{option} {value}: say which item this is with --item NAME")
        return None
    from palpate.produce.keeping import Keeper
    from palpate.produce.records import Item

    Item(item_id=item_id)
    keeper = stack.enter_context(Keeper(store))
    if keeper.away is not None:
        print(f"palpate grasp: {keeper.away}. The grasp will wait for it.", file=sys.stderr)
    return keeper


def remember(
    result: GraspResult,
    *,
    keeper: Keeper,
    item_id: str,
    angle_deg: float | None,
    rig: Rig,
    observations: Sequence[Observation],
    recording: Path | None,
) -> dict[str, object]:
    """Keep a grasp with the calibration it rests on; return what the JSON says of it.

    `stored` is True where the store has it, False where it waits, None where it is lost.
    """
    from palpate.produce.felt_pixels import felt_pixels
    from palpate.produce.records import MEASURED, Grasp
    from palpate.produce.records_json import CalibrationText
    from palpate.produce.store_writing import calibration_id_of

    calibration = rig.calibration.as_text()
    measured = {name: getattr(result, name) for name in MEASURED}
    grasp = Grasp(
        item_id=item_id,
        taken_at=datetime.now(UTC),
        rig=rig.name,
        drive=rig.gripper.limits.drive,
        origin=rig.origin,
        outcome=result.outcome,
        measurements={name: value for name, value in measured.items() if value is not None},
        pixel_settled_percent=felt_pixels(observations, result=result, layout=rig.array.layout),
        decision_time_s=result.decision_time_s,
        peak_force_n=result.peak_force_n,
        angle_deg=angle_deg,
        calibration_id=calibration_id_of(calibration),
        recording=None if recording is None else str(recording.resolve()),
    )
    try:
        stored = keeper.keep(CalibrationText(content=calibration), grasp)
    except OSError as error:
        print(
            f"palpate grasp: {keeper.away}, and {keeper.spool.path} can't be written "
            f"({error.strerror}): the grasp is NOT kept",
            file=sys.stderr,
        )
        return {"item_id": item_id, "grasp_id": grasp.grasp_id, "stored": None}
    if not stored:
        print(
            f"palpate grasp: {keeper.away}. The grasp waits in {keeper.spool.path}; the next one "
            "that finds the store takes it there.",
            file=sys.stderr,
        )
    return {"item_id": item_id, "grasp_id": grasp.grasp_id, "stored": stored}
