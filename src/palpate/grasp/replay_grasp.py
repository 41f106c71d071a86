"""Replay of a recorded grasp through the controller, which repeats the live run's decisions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from palpate.calibration import Calibration
from palpate.clock import Clock
from palpate.errors import RecordingError
from palpate.grasp.controller import PAPER_HANDLERS
from palpate.grasp.estimator import Observation
from palpate.grasp.paper import Paper
from palpate.grasp.paper_method import record_size, use_paper_method
from palpate.grasp.phases import Phase
from palpate.grasp.plan import HOLD_S, Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.grasp.result import GraspResult, Outcome
from palpate.grasp.runner import Subscriber, Watcher, run_grasp
from palpate.grasp.state import GraspState
from palpate.gripper.interface import Gripper
from palpate.object.damage_file import read_recorded_model
from palpate.recording import RecordingInfo, Replay, ReplayGripper


def replay_grasp(
    source: Replay,
    *,
    clock: Clock,
    gripper: Gripper | None = None,
    subscribers: Sequence[Subscriber] = (),
    watchers: Sequence[Watcher] = (),
) -> GraspResult:
    """Run the controller on a recorded grasp.

    `gripper`: receives the commands; the recorded gripper by default, which ignores them.
    `subscribers`, `watchers`: receive every observation and every state, as in `run_grasp`.
    Raises `RecordingError` if the recording has no calibration or no gripper, and
    `CalibrationError` if its calibration can't be read.
    """
    gripper = gripper or ReplayGripper(source)
    end, requests = source.end, Requests()

    def repeat_request(state: GraspState) -> None:
        if end is not None and state.estimate.now_s >= end.time_s:
            (requests.stop if end.name == "stop" else requests.release).set()

    hold_s = HOLD_S if end is None else math.inf
    return run_grasp(
        plan_of_recording(source.info, gripper=gripper, hold_s=hold_s),
        array=source,
        gripper=gripper,
        clock=clock,
        subscribers=subscribers,
        watchers=[*watchers, repeat_request],
        requests=requests,
    )


def plan_of_recording(info: RecordingInfo, *, gripper: Gripper, hold_s: float = HOLD_S) -> Plan:
    """Return the plan of a recorded grasp.

    Raises `RecordingError` if the recording has no calibration of its sensor, and
    `CalibrationError` if that calibration can't be read.
    """
    if info.calibration is None:
        raise RecordingError("the recording names no calibration, so its grasps can't be replayed")
    calibration = Calibration.from_text(info.calibration, where="the recording")
    if difference := calibration.layout.describe_difference(info.layout):
        raise RecordingError(f"its calibration belongs to another sensor ({difference})")
    plan = plan_grasp(
        calibration,
        gripper=gripper,
        target_force_n=info.target_force_n,
        expect_size_mm=info.expect_size_mm,
        tighten=info.tighten,
        damage=read_recorded_model(info.damage),
        kind=info.kind,
        hold_s=hold_s,
    )
    if info.paper is None:
        return plan
    return use_paper_method(plan, Paper.from_text(info.paper), calibration=calibration)


def evaluate_with_paper_method(source: Replay, paper: Paper) -> GraspResult:
    """Evaluate a recorded grasp with the paper's method and the recorded movements.

    Contact is the first stop of the hand at which the mean change passes the threshold. The
    prediction uses the readings up to the cutoff after the last movement. The recorded extra
    closing is used.

    Raises `RecordingError` or `CalibrationError` as `replay_grasp`.
    """
    gripper = ReplayGripper(source)
    plan = plan_of_recording(replace(source.info, paper=paper.as_text()), gripper=gripper)
    state, closure, stops, was_moving = GraspState(), math.nan, [0.0], False
    while not source.has_ended and state.phase not in (Phase.HOLD, Phase.RELEASE):
        frame = source.read(timeout_s=math.inf)
        report = gripper.state()
        # A small step may begin and end between two frames, without a report of movement.
        before, closure = closure, gripper.limits.closure(report)
        stepped = not was_moving and abs(closure - before) > plan.smallest_step / 2
        was_moving = report.moving
        report = replace(report, moving=report.moving or stepped)
        state.estimate.update(Observation(frame=frame, gripper=report), plan=plan)
        state.record_finger_events()
        if report.moving:
            state.estimate.moved_s = frame.time_s
            continue
        seeking = state.phase is Phase.APPROACH
        PAPER_HANDLERS[state.phase](state, plan)
        if seeking and state.phase is Phase.SQUEEZE:
            # The hand may have stopped too briefly for a reading there.
            before = max((stop for stop in stops if stop < closure), default=closure)
            record_size(state, plan, before=before)
        stops.append(closure)
    answered = state.result.settled_percent is not None
    unanswered = state.phase in (Phase.SQUEEZE, Phase.SETTLE) and not answered
    if unanswered:
        state.add_fault(
            f"the hand was never stationary for {paper.cutoff_s:g} s after contact; use a shorter "
            "--cutoff"
        )
    outcome = Outcome.HELD if answered or unanswered else Outcome.NOTHING_THERE
    # The method measures no force while the hand moves.
    return replace(state.final_result, outcome=outcome, peak_force_n=None)
