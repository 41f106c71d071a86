"""A recording on the page: its frames at their own pace, and its grasp decided again."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from threading import Event

from palpate.clock import RealClock
from palpate.dashboard.grip_force import ForceLaws
from palpate.dashboard.messages import Grasped, Guide, Play, Source
from palpate.dashboard.outlet import Outlet
from palpate.errors import DeviceTimeoutError, RecordingError
from palpate.estimate.damage_file import recorded_model
from palpate.grasp.belief import Belief, Observation
from palpate.grasp.controller import released, step
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.planning import plan_grasp
from palpate.grasp.requests import Requests
from palpate.gripper.interface import GripperState
from palpate.recording import PacedClock, RecordingReader, Replay, ReplayGripper
from palpate.recording.replay import observations
from palpate.sensor.array import Frame
from palpate.sensor.calibration import Calibration

#: A stop is heard within this time where a recording has nothing to show.
_PATIENCE_S = 0.05


def play(order: Play, *, outlet: Outlet, requests: Requests, confirmed: Event) -> None:
    """Show a recording, and what the controller makes of its grasp, if it holds one.

    It stays on the screen until the user wants to see the rig again, or stops it.

    Raises
    ------
    RecordingError
        If it can't be read or holds no frames.
    """
    with RecordingReader(order.file) as reader:
        first = next(observations(reader), None)
    if first is None:
        raise RecordingError(f"{order.file}: no frames to show")
    clock = PacedClock(RealClock(), start_s=first[0].time_s, speed=order.speed)
    with closing(Replay(order.file, clock=clock)) as replay:
        plan = _plan_of(replay)
        outlet.begin(_source_of(replay, order.file, plan))
        outlet.think(plan)
        again = None if plan is None else _Again(plan)
        while not replay.ended and not requests.stop.is_set():
            try:
                frame = replay.read(timeout_s=_PATIENCE_S)
            except DeviceTimeoutError:  # frames were lost there
                continue
            state = replay.gripper_state
            outlet.see(frame, state)
            if again is not None and state is not None:
                again.see(frame, state)
                outlet.believe(again.belief)
    if again is not None:
        outlet.note(Grasped(result=again.belief.result, recording=order.file))
    confirmed.clear()
    outlet.note(Guide(text="The recording has ended", share=1.0, asks=True))
    while not confirmed.wait(_PATIENCE_S) and not requests.stop.is_set():
        pass


class _Again:
    """The pure controller on recorded frames: nothing is commanded, everything is decided again."""

    def __init__(self, plan: Plan) -> None:
        self._plan, self.belief = plan, Belief()

    def see(self, frame: Frame, state: GripperState) -> None:
        held_at = self.belief.closure
        if not self.belief.ended:
            seen = Observation(frame=frame, gripper=state)
            self.belief, _ = step(self.belief, seen, plan=self._plan)
        # The plan holds on; when the recorded hand opened, its user wanted the object back.
        if self.belief.phase is Phase.HOLD and state.moving and self.belief.closure < held_at:
            self.belief, _ = released(self.belief, plan=self._plan)


def _calibration_of(replay: Replay) -> Calibration | None:
    stated = replay.info.calibration
    return None if stated is None else Calibration.from_text(stated, where="the recording")


def _plan_of(replay: Replay) -> Plan | None:
    info, calibration = replay.info, _calibration_of(replay)
    if info.gripper is None or calibration is None:
        return None
    gripper = ReplayGripper(replay)
    # It holds for as long as the recording does.
    endless = {"hold_s": float("inf"), "longest_s": float("inf")}
    return plan_grasp(
        calibration,
        gripper=gripper,
        target_force_n=info.target_force_n,
        damage=recorded_model(info.damage),
        kind=info.kind,
        **endless,
    )


def _source_of(replay: Replay, file: Path, plan: Plan | None) -> Source:
    return Source(
        name=file.name,
        layout=replay.layout,
        rest_ohm=None if plan is None else plan.rest_ohm,
        gripper=replay.info.gripper,
        origin=replay.info.origin,
        replayed=True,
        laws=ForceLaws.of(_calibration_of(replay)),
    )
