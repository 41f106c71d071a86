"""A recorded grasp through the controller again: the decisions are those of the live run."""

from __future__ import annotations

from collections.abc import Sequence

from palpate.clock import Clock
from palpate.errors import RecordingError
from palpate.estimate.damage_file import recorded_model
from palpate.grasp.planning import plan_grasp
from palpate.grasp.result import GraspResult
from palpate.grasp.runner import Subscriber, Watcher, run_grasp
from palpate.gripper.interface import Gripper
from palpate.recording import Replay, ReplayGripper
from palpate.sensor.calibration import Calibration


def decide_again(
    source: Replay,
    *,
    clock: Clock,
    gripper: Gripper | None = None,
    subscribers: Sequence[Subscriber] = (),
    watchers: Sequence[Watcher] = (),
) -> GraspResult:
    """Run a recorded grasp again.

    `gripper`: takes the commands; by default the recorded one, which they don't change.
    `subscribers`, `watchers`: see every observation and every belief, as in `run_grasp`.
    Raises `RecordingError` if it is not of a grasp: it has no calibration or no gripper;
    `CalibrationError` if its calibration can't be read.
    """
    info = source.info
    if info.calibration is None:
        raise RecordingError("the recording names no calibration, so no grasp can be decided again")
    gripper = gripper or ReplayGripper(source)
    plan = plan_grasp(
        Calibration.from_text(info.calibration, where="the recording"),
        gripper=gripper,
        target_force_n=info.target_force_n,
        expect_size_mm=info.expect_size_mm,
        damage=recorded_model(info.damage),
        kind=info.kind,
    )
    return run_grasp(
        plan,
        array=source,
        gripper=gripper,
        clock=clock,
        subscribers=subscribers,
        watchers=watchers,
    )
