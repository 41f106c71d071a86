"""A recording on the page: its grasp is decided again, then shown at any time."""

from __future__ import annotations

import math
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from threading import Event

from palpate.clock import ManualClock
from palpate.dashboard.grasp_progress import GraspProgress, force_laws, grasp_progress_of
from palpate.dashboard.live import CURVE_S, POINTS_PER_S
from palpate.dashboard.messages import (
    FrameSource,
    Grasped,
    Guide,
    RecordedSegment,
    ReplayPosition,
    Timeline,
)
from palpate.dashboard.telemetry import Telemetry, frame_columns
from palpate.errors import RecordingError
from palpate.grasp.controller import GraspController
from palpate.grasp.decide_again import plan_of_recording
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.requests import Requests
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingReader, Replay, ReplayGripper
from palpate.recording.replay import observations
from palpate.sensor.array import Frame
from palpate.sensor.calibration import Calibration


class PlaybackClock:
    """A thread-safe clock that can be paused, moved and sped up.

    Parameters
    ----------
    speed : float
        Seconds of the recording in a second on the wall.
    now_s : callable
        The wall's time.

    Examples
    --------
    >>> wall_s = [0.0]
    >>> clock = PlaybackClock(speed=2.0, now_s=lambda: wall_s[0])
    >>> clock.begin(start_s=10.0, end_s=20.0)
    >>> wall_s[0] = 3.0
    >>> clock.at_s
    16.0
    >>> clock.pause(True); clock.seek(12.0)
    >>> wall_s[0] = 9.0
    >>> clock.at_s
    12.0
    """

    def __init__(self, *, speed: float, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s, self._lock = now_s, threading.Lock()
        #: Seconds of the recording in a second, and whether it is paused; set by the methods.
        self.speed, self.paused = speed, False
        self.begin(start_s=0.0, end_s=0.0)

    def begin(self, *, start_s: float, end_s: float) -> None:
        """Begin a recording that lasts from one time to another; the clock stays between them."""
        with self._lock:
            self._start_s, self._end_s = start_s, end_s
            self._anchor_s, self._wall_s = start_s, self._now_s()

    @property
    def at_s(self) -> float:
        """The recording's time now."""
        with self._lock:
            return self._at_s()

    def seek(self, time_s: float) -> None:
        """Continue from this time of the recording."""
        with self._lock:
            self._anchor_s, self._wall_s = self._clip(time_s), self._now_s()

    def pause(self, paused: bool) -> None:
        """Pause or continue; at the end, restart."""
        with self._lock:
            at_s = self._at_s()
            restarts = self.paused and not paused and at_s >= self._end_s
            self._anchor_s, self._wall_s = self._start_s if restarts else at_s, self._now_s()
            self.paused = paused

    def set_speed(self, speed: float) -> None:
        """Set the speed from now on."""
        with self._lock:
            self._anchor_s, self._wall_s = self._at_s(), self._now_s()
            self.speed = speed

    def _at_s(self) -> float:
        passed_s = 0.0 if self.paused else self.speed * (self._now_s() - self._wall_s)
        return self._clip(self._anchor_s + passed_s)

    def _clip(self, time_s: float) -> float:
        return min(max(time_s, self._start_s), self._end_s)


FrameWithState = tuple[Frame, GripperState | None]

#: Period of the picture; a stop, or leaving the replay, takes effect within this time.
_TICK_S = 0.04
#: A forecast is made for each stretch of this length, as live; of a long recording, for fewer.
_SEGMENT_S, _MAX_SEGMENTS = 0.2, 450
_MAX_POINTS = int(CURVE_S * POINTS_PER_S)


def play(
    file: Path,
    *,
    telemetry: Telemetry,
    requests: Requests,
    confirmed: Event,
    playback: PlaybackClock,
) -> None:
    """Play a recording, with the controller's decisions if it holds a grasp.

    It stays on the screen until the user wants to see the rig again, or stops it. `playback` pauses
    and moves it.

    Raises
    ------
    RecordingError
        If it can't be read or holds no frames.
    """
    with RecordingReader(file) as reader:
        frames = list(observations(reader))
    if not frames:
        raise RecordingError(f"{file}: no frames to show")
    confirmed.clear()
    with closing(Replay(file, clock=ManualClock())) as replay:
        controller, source = _open_replay(replay, name=file.name)
    telemetry.begin(source)
    telemetry.set_plan(None)
    decided = _recompute_decisions(
        frames, controller=controller, source=source, telemetry=telemetry, requests=requests
    )
    if decided is None:
        return
    telemetry.note(decided.timeline)
    telemetry.note(Guide(text=f"Replay of {file.stem}", needs_confirmation=True))
    playback.begin(start_s=decided.timeline.start_s, end_s=decided.timeline.end_s)
    shown: tuple[float, bool, float] | None = None
    while not requests.stop.is_set():
        now = playback.at_s, playback.paused, playback.speed
        if now != shown:
            shown = now
            _send_position(decided, now, telemetry=telemetry, file=file)
        if confirmed.wait(_TICK_S):
            return


@dataclass(frozen=True, slots=True, kw_only=True)
class _DecidedRecording:
    """A recording with its decisions."""

    frames: list[FrameWithState]
    time_s: list[float]
    #: At the end of each stretch.
    progresses: list[GraspProgress]
    timeline: Timeline


def _send_position(
    decided: _DecidedRecording, now: tuple[float, bool, float], *, telemetry: Telemetry, file: Path
) -> None:
    """Send the frame and the progress of the grasp at one time."""
    at_s, paused, speed = now
    frame, state = decided.frames[max(bisect_right(decided.time_s, at_s) - 1, 0)]
    at_end, progress, grasped = at_s >= decided.timeline.end_s, None, None
    if decided.progresses:
        before = bisect_right(decided.progresses, at_s, key=lambda one: one.time_s) - 1
        progress = decided.progresses[-1 if at_end else max(before, 0)]
        grasped = Grasped(result=progress.answer, recording=file) if at_end else None
    telemetry.show_recorded(frame, state, progress)
    telemetry.note(
        ReplayPosition(time_s=at_s, paused=paused or at_end, speed=speed, grasped=grasped)
    )


def _recompute_decisions(
    frames: list[FrameWithState],
    *,
    controller: _ReplayController | None,
    source: FrameSource,
    telemetry: Telemetry,
    requests: Requests,
) -> _DecidedRecording | None:
    """Decide the recording again at full speed, and send its curve; None if stopped."""
    time_s = [frame.time_s for frame, _ in frames]
    length_s = time_s[-1] - time_s[0]
    every = math.ceil(len(frames) / min(_MAX_POINTS, max(length_s * POINTS_PER_S, 1.0)))
    progresses: list[GraspProgress] = []
    phases: list[tuple[float, str]] = []
    for segment in _split_frames(frames, lasting_s=max(_SEGMENT_S, length_s / _MAX_SEGMENTS)):
        if requests.stop.is_set():
            return None
        for frame, state in segment:
            if controller is not None and state is not None:
                controller.step(frame, state)
                if not phases or phases[-1][1] != controller.grasp_state.activity:
                    phases.append((frame.time_s, controller.grasp_state.activity))
        if controller is not None and controller.grasp_state.estimate.frames:
            before = progresses[-1] if progresses else None
            progresses.append(controller.progress(before))
        thinned = segment[::-every][::-1]
        past = RecordedSegment(
            frames=frame_columns(thinned, source), progress=progresses[-1] if progresses else None
        )
        telemetry.note(past)
        fraction = (segment[-1][0].time_s - time_s[0]) / (length_s or 1.0)
        telemetry.note(Guide(text="Deciding the recorded grasp again", fraction=fraction))
    timeline = Timeline(
        start_s=time_s[0],
        end_s=time_s[-1],
        phases=tuple(phases),
        ended=progresses[-1] if progresses else None,
    )
    return _DecidedRecording(frames=frames, time_s=time_s, progresses=progresses, timeline=timeline)


def _split_frames(
    frames: list[FrameWithState], *, lasting_s: float
) -> Iterator[list[FrameWithState]]:
    """Yield the frames in chunks of roughly equal length."""
    first = 0
    for index, (frame, _) in enumerate(frames):
        if frame.time_s - frames[first][0].time_s >= lasting_s:
            yield frames[first:index]
            first = index
    yield frames[first:]


class _ReplayController:
    """The controller on recorded frames, without a gripper."""

    def __init__(self, plan: Plan, *, end_s: float) -> None:
        self._controller, self._end_s = GraspController(plan), end_s
        self.grasp_state = self._controller.state

    def step(self, frame: Frame, report: GripperState) -> None:
        if not self.grasp_state.has_ended:
            self._controller.step(Observation(frame=frame, gripper=report))
        if self.grasp_state.phase is Phase.HOLD and frame.time_s >= self._end_s:
            self._controller.release()

    def progress(self, before: GraspProgress | None) -> GraspProgress:
        plan = self._controller.plan
        return grasp_progress_of(self.grasp_state, plan=plan, before=before, forecasts=True)


def _open_replay(replay: Replay, *, name: str) -> tuple[_ReplayController | None, FrameSource]:
    """Return the controller of the recorded grasp, and the description of its frames."""
    info, calibration, controller = replay.info, None, None
    if info.calibration is not None:
        calibration = Calibration.from_text(info.calibration, where="the recording")
    if calibration is not None and info.gripper is not None:
        # It holds until the recorded release.
        plan = plan_of_recording(info, gripper=ReplayGripper(replay), hold_s=math.inf)
        end = replay.end
        controller = _ReplayController(plan, end_s=math.inf if end is None else end.time_s)
    source = FrameSource(
        name=name,
        layout=info.layout,
        rest_ohm=None if calibration is None else calibration.rest_ohm,
        gripper=info.gripper,
        origin=info.origin,
        replayed=True,
        laws=force_laws(calibration),
    )
    return controller, source
