"""Replay a recording on the page, with recomputed decisions for a recorded grasp."""

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

from palpate.calibration import Calibration
from palpate.clock import ManualClock
from palpate.errors import RecordingError
from palpate.grasp.controller import GraspController
from palpate.grasp.document import GraspDocument
from palpate.grasp.estimator import Observation
from palpate.grasp.phases import Phase
from palpate.grasp.plan import Plan
from palpate.grasp.replay_grasp import plan_of_recording
from palpate.grasp.requests import Requests
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingReader, Replay, ReplayGripper
from palpate.recording.replay import observations
from palpate.sensor.array import Frame
from palpate_station.dashboard.grasp_progress import GraspProgress, force_law, grasp_progress_of
from palpate_station.dashboard.live import CURVE_S, POINTS_PER_S
from palpate_station.dashboard.messages import (
    FrameSource,
    Grasped,
    Guide,
    RecordedSegment,
    ReplayPosition,
    Timeline,
    Trouble,
)
from palpate_station.dashboard.telemetry import Telemetry, frame_columns


class PlaybackClock:
    """A thread-safe playback clock with pause, seek and speed.

    Parameters
    ----------
    speed : float
        Seconds of the recording per real second.
    now_s : callable
        Returns the real time, seconds.

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
        #: Seconds of the recording per real second, and whether the clock is paused. Read-only.
        self.speed, self.paused = speed, False
        self.begin(start_s=0.0, end_s=0.0)

    def begin(self, *, start_s: float, end_s: float) -> None:
        """Start at the beginning of a recording; the clock stays within its time range."""
        with self._lock:
            self._start_s, self._end_s = start_s, end_s
            self._anchor_s, self._wall_s = start_s, self._now_s()

    @property
    def at_s(self) -> float:
        """The current time of the recording, seconds."""
        with self._lock:
            return self._at_s()

    def seek(self, time_s: float) -> None:
        """Continue from `time_s` in the recording."""
        with self._lock:
            self._anchor_s, self._wall_s = self._clip(time_s), self._now_s()

    def pause(self, paused: bool) -> None:
        """Pause or continue; continuing at the end restarts the recording."""
        with self._lock:
            at_s = self._at_s()
            restarts = self.paused and not paused and at_s >= self._end_s
            self._anchor_s, self._wall_s = self._start_s if restarts else at_s, self._now_s()
            self.paused = paused

    def set_speed(self, speed: float) -> None:
        """Change the speed from now on."""
        with self._lock:
            self._anchor_s, self._wall_s = self._at_s(), self._now_s()
            self.speed = speed

    def _at_s(self) -> float:
        passed_s = 0.0 if self.paused else self.speed * (self._now_s() - self._wall_s)
        return self._clip(self._anchor_s + passed_s)

    def _clip(self, time_s: float) -> float:
        return min(max(time_s, self._start_s), self._end_s)


FrameWithState = tuple[Frame, GripperState | None]

#: Update period of the replay, and thus the maximum delay of a stop or of its end, seconds.
_TICK_S = 0.04
#: Length of a segment, seconds, each with a forecast as during a live grasp, and the maximum number
#: of segments; a long recording has longer segments.
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
    """Replay a recording, with the controller's decisions if it contains a grasp.

    The replay continues until the user confirms its end or stops it. `playback` controls pause,
    position and speed. Damage of the file is a `Trouble` for the page.

    Raises
    ------
    RecordingError
        If the recording can't be read or contains no frames.
    """
    with RecordingReader(file) as reader:
        damage = reader.state.describe()
        frames = list(observations(reader))
    if not frames:
        raise RecordingError(f"{file}: the recording contains no frames")
    confirmed.clear()
    with closing(Replay(file, clock=ManualClock())) as replay:
        controller, source = _open_replay(replay, name=file.name)
    telemetry.begin(source)
    telemetry.set_plan(None)
    if damage:
        telemetry.note(Trouble(f"{file.name}: {damage}; the replay shows what can be read"))
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
    """A recording with the recomputed decisions."""

    frames: list[FrameWithState]
    time_s: list[float]
    #: Progress at the end of each segment.
    progresses: list[GraspProgress]
    timeline: Timeline


def _send_position(
    decided: _DecidedRecording, now: tuple[float, bool, float], *, telemetry: Telemetry, file: Path
) -> None:
    """Send the frame and the grasp progress at a position of the replay."""
    at_s, paused, speed = now
    frame, state = decided.frames[max(bisect_right(decided.time_s, at_s) - 1, 0)]
    at_end, progress, grasped = at_s >= decided.timeline.end_s, None, None
    if decided.progresses:
        before = bisect_right(decided.progresses, at_s, key=lambda one: one.time_s) - 1
        progress = decided.progresses[-1 if at_end else max(before, 0)]
        if at_end:
            document = GraspDocument(
                result=progress.answer,
                target_force_n=progress.bounds.target_n,
                damage_low_n=progress.bounds.damage_low_n or math.inf,
            )
            grasped = Grasped(document=document, recording=file)
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
    """Recompute the decisions at full speed, and send the curve; None if stopped."""
    time_s = [frame.time_s for frame, _ in frames]
    length_s = time_s[-1] - time_s[0]
    every = math.ceil(len(frames) / min(_MAX_POINTS, max(length_s * POINTS_PER_S, 1.0)))
    progresses: list[GraspProgress] = []
    phases: list[tuple[float, str]] = []
    for segment in _split_frames(frames, duration_s=max(_SEGMENT_S, length_s / _MAX_SEGMENTS)):
        if requests.stop.is_set():
            return None
        for frame, state in segment:
            if controller is not None and state is not None:
                controller.step(frame, state)
                name = controller.grasp_state.activity.value
                if not phases or phases[-1][1] != name:
                    phases.append((frame.time_s, name))
        if controller is not None and controller.grasp_state.estimate.frames:
            before = progresses[-1] if progresses else None
            progresses.append(controller.progress(before))
        thinned = segment[::-every][::-1]
        past = RecordedSegment(
            frames=frame_columns(thinned, source), progress=progresses[-1] if progresses else None
        )
        telemetry.note(past)
        fraction = (segment[-1][0].time_s - time_s[0]) / (length_s or 1.0)
        telemetry.note(Guide(text="Recomputing the decisions of the grasp", fraction=fraction))
    timeline = Timeline(
        start_s=time_s[0],
        end_s=time_s[-1],
        phases=tuple(phases),
        ended=progresses[-1] if progresses else None,
    )
    return _DecidedRecording(frames=frames, time_s=time_s, progresses=progresses, timeline=timeline)


def _split_frames(
    frames: list[FrameWithState], *, duration_s: float
) -> Iterator[list[FrameWithState]]:
    """Yield the frames in segments of roughly equal duration."""
    first = 0
    for index, (frame, _) in enumerate(frames):
        if frame.time_s - frames[first][0].time_s >= duration_s:
            yield frames[first:index]
            first = index
    yield frames[first:]


class _ReplayController:
    """The grasp controller, applied to recorded frames without a gripper."""

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
    """Return the controller of the recorded grasp, if any, and the frame source."""
    info, calibration, controller = replay.info, None, None
    if info.calibration is not None:
        calibration = Calibration.from_text(info.calibration, where="the recording")
    if calibration is not None and info.gripper is not None:
        # The controller holds until the recorded release.
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
        law=force_law(calibration),
    )
    return controller, source
