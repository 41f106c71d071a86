"""A recording of what a rig gives: of a grasp, or of what is watched."""

from __future__ import annotations

import time
from pathlib import Path

from palpate import __version__
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.rig import Rig


def open_recording(
    path: Path, *, rig: Rig, seed: int, target_force_n: float | None = None
) -> RecordingWriter:
    """Begin a recording; with the calibration and the limits, so that a grasp can be replayed.

    Raises
    ------
    RecordingError
        If the file exists or can't be made.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    info = RecordingInfo(
        layout=rig.array.layout,
        origin=rig.origin,
        rig=rig.name,
        calibration=rig.calibration.as_text(),
        gripper=rig.gripper.limits,
        target_force_n=target_force_n,
        seed=seed if rig.simulated else None,
        versions={"palpate": __version__},
        clock_zero_unix_ns=0 if rig.simulated else time.time_ns() - time.monotonic_ns(),
    )
    return RecordingWriter(path, info=info)
