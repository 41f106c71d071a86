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
    Playing,
    RecordedStretch,
    Timeline,
)
from palpate.dashboard.telemetry import Telemetry, columns
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
            again = self.paused and not paused and at_s >= self._end_s
            self._anchor_s, self._wall_s = self._start_s if again else at_s, self._now_s()
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


Seen = tuple[Frame, GripperState | None]

#: Period of the picture; a stop, or leaving the replay, takes effect within this time.
_TICK_S = 0.04
#: A forecast is made for each stretch of this length, as live; of a long recording, for fewer.
_STRETCH_S, _MOST_STRETCHES = 0.2, 450
_MOST_POINTS = int(CURVE_S * POINTS_PER_S)


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
        seen = list(observations(reader))
    if not seen:
        raise RecordingError(f"{file}: no frames to show")
    confirmed.clear()
    with closing(Replay(file, clock=ManualClock())) as replay:
        again, source = _open_replay(replay, name=file.name)
    telemetry.begin(source)
    telemetry.set_plan(None)
    whole = _decide_again(seen, again=again, source=source, telemetry=telemetry, requests=requests)
    if whole is None:
        return
    telemetry.note(whole.timeline)
    telemetry.note(Guide(text=f"Replay of {file.stem}", asks=True))
    playback.begin(start_s=whole.timeline.start_s, end_s=whole.timeline.end_s)
    shown: tuple[float, bool, float] | None = None
    while not requests.stop.is_set():
        now = playback.at_s, playback.paused, playback.speed
        if now != shown:
            shown = now
            _show(whole, now, telemetry=telemetry, file=file)
        if confirmed.wait(_TICK_S):
            return


@dataclass(frozen=True, slots=True, kw_only=True)
class _Whole:
    """A recording with its decisions."""

    seen: list[Seen]
    time_s: list[float]
    #: At the end of each stretch.
    progresses: list[GraspProgress]
    timeline: Timeline


def _show(
    whole: _Whole, now: tuple[float, bool, float], *, telemetry: Telemetry, file: Path
) -> None:
    """Send the frame and the progress of the grasp at one time."""
    at_s, paused, speed = now
    frame, state = whole.seen[max(bisect_right(whole.time_s, at_s) - 1, 0)]
    at_end, progress, grasped = at_s >= whole.timeline.end_s, None, None
    if whole.progresses:
        before = bisect_right(whole.progresses, at_s, key=lambda one: one.time_s) - 1
        progress = whole.progresses[-1 if at_end else max(before, 0)]
        grasped = Grasped(result=progress.answer, recording=file) if at_end else None
    telemetry.show_recorded(frame, state, progress)
    telemetry.note(Playing(time_s=at_s, paused=paused or at_end, speed=speed, grasped=grasped))


def _decide_again(
    seen: list[Seen],
    *,
    again: _Again | None,
    source: FrameSource,
    telemetry: Telemetry,
    requests: Requests,
) -> _Whole | None:
    """Decide the recording again at full speed, and send its curve; None if stopped."""
    time_s = [frame.time_s for frame, _ in seen]
    length_s = time_s[-1] - time_s[0]
    every = math.ceil(len(seen) / min(_MOST_POINTS, max(length_s * POINTS_PER_S, 1.0)))
    progresses: list[GraspProgress] = []
    phases: list[tuple[float, str]] = []
    for stretch in _split_frames(seen, lasting_s=max(_STRETCH_S, length_s / _MOST_STRETCHES)):
        if requests.stop.is_set():
            return None
        for frame, state in stretch:
            if again is not None and state is not None:
                again.step(frame, state)
                if not phases or phases[-1][1] != again.grasp_state.activity:
                    phases.append((frame.time_s, again.grasp_state.activity))
        if again is not None and again.grasp_state.estimate.frames:
            before = progresses[-1] if progresses else None
            progresses.append(again.progress(before))
        thinned = stretch[::-every][::-1]
        past = RecordedStretch(
            frames=columns(thinned, source), progress=progresses[-1] if progresses else None
        )
        telemetry.note(past)
        share = (stretch[-1][0].time_s - time_s[0]) / (length_s or 1.0)
        telemetry.note(Guide(text="Deciding the recorded grasp again", share=share))
    timeline = Timeline(
        start_s=time_s[0],
        end_s=time_s[-1],
        phases=tuple(phases),
        ended=progresses[-1] if progresses else None,
    )
    return _Whole(seen=seen, time_s=time_s, progresses=progresses, timeline=timeline)


def _split_frames(seen: list[Seen], *, lasting_s: float) -> Iterator[list[Seen]]:
    """Yield the frames in chunks of roughly equal length."""
    first = 0
    for index, (frame, _) in enumerate(seen):
        if frame.time_s - seen[first][0].time_s >= lasting_s:
            yield seen[first:index]
            first = index
    yield seen[first:]


class _Again:
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


def _open_replay(replay: Replay, *, name: str) -> tuple[_Again | None, FrameSource]:
    """Return the controller of the recorded grasp, and the description of its frames."""
    info, calibration, again = replay.info, None, None
    if info.calibration is not None:
        calibration = Calibration.from_text(info.calibration, where="the recording")
    if calibration is not None and info.gripper is not None:
        # It holds until the recorded release.
        plan = plan_of_recording(info, gripper=ReplayGripper(replay), hold_s=math.inf)
        end = replay.end
        again = _Again(plan, end_s=math.inf if end is None else end.time_s)
    source = FrameSource(
        name=name,
        layout=info.layout,
        rest_ohm=None if calibration is None else calibration.rest_ohm,
        gripper=info.gripper,
        origin=info.origin,
        replayed=True,
        laws=force_laws(calibration),
    )
    return again, source
