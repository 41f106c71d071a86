"""Send frames and progress from the device loop to the page at screen rate.

The loop only appends to a bounded queue, so slow or blocked pages can't delay it.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from palpate.grasp.estimator import Observation
from palpate.grasp.plan import Plan
from palpate.grasp.safety import SafetyLimits
from palpate.grasp.state import GraspState
from palpate.gripper.interface import GripperState
from palpate.sensor.array import Frame, LinkCounters
from palpate_station.dashboard.grasp_progress import GraspProgress, grasp_progress_of
from palpate_station.dashboard.messages import Frames, FrameSource, LinkStatus, Note, Update

SEND_PERIOD_S = 0.05
#: Maximum number of unsent frames, two seconds at 500 frames/s; older frames are dropped.
_MAX_FRAMES = 1000
#: The frame rate is computed over this time, seconds.
_RATE_WINDOW_S = 2.0
_FORECAST_PERIOD_S = 0.2
#: Maximum time to send the last update, seconds.
_CLOSE_TIMEOUT_S = 2.0
_STALE = SafetyLimits()
#: Number of frames for the percentiles of the loop's period.
_PERIODS = 1000


@dataclass(slots=True)
class _FrameCounts:
    """Counts since the source was opened."""

    frames: int = 0
    lost: int = 0
    sequence: int | None = None
    arrived_s: float = math.nan
    period_s: float = math.nan


class Telemetry:
    """Collects frames and grasp states from the device loop; a thread sends the updates.

    Parameters
    ----------
    send : callable
        Sends an update. It may block, and raises `OSError` if the other end is closed.
    on_lost : callable
        Called once after this `OSError`.
    """

    def __init__(self, send: Callable[[Update], None], *, on_lost: Callable[[], None]) -> None:
        self._send, self._on_lost = send, on_lost
        self._lock = threading.Lock()
        self._frames: deque[tuple[Frame, GripperState | None]] = deque(maxlen=_MAX_FRAMES)
        self._notes: list[Note] = []
        self._source: FrameSource | None = None
        self._events: Callable[[], LinkCounters] = LinkCounters
        self._counts_gaps = True
        self._frame_counts = _FrameCounts()
        self._recent: deque[tuple[float, int]] = deque()
        self._periods_s: deque[float] = deque(maxlen=_PERIODS)
        self._plan: Plan | None = None
        self._grasp_state: GraspState | None = None
        self._progress: GraspProgress | None = None
        self._forecast_s = -math.inf
        self._closed, self._send_now = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="telemetry", daemon=True)

    def start(self) -> None:
        """Start sending."""
        self._thread.start()

    def close(self) -> None:
        """Send the last update and end, even if the page no longer reads."""
        self._closed.set()
        self._send_now.set()
        self._thread.join(_CLOSE_TIMEOUT_S)

    def note(self, note: Note, *, at_once: bool = False) -> None:
        """Send a note; notes are never dropped and precede later frames."""
        with self._lock:
            self._notes.append(note)
        if at_once:
            self._send_now.set()

    def begin(
        self,
        source: FrameSource,
        *,
        events: Callable[[], LinkCounters] = LinkCounters,
        linked: bool = True,
    ) -> None:
        """Switch to another source of frames; `events` returns the counters of its link.

        Gaps in the sequence numbers count as losses only if `linked`. The twin scans frames between
        reads, so its gaps are not losses.
        """
        with self._lock:
            self._frames.clear()
            self._recent.clear()
            self._periods_s.clear()
            self._frame_counts, self._source, self._events = _FrameCounts(), source, events
            self._counts_gaps = linked
            self._notes.append(source)

    def set_plan(self, plan: Plan | None) -> None:
        """Set the plan of the running grasp; None without a grasp."""
        with self._lock:
            self._plan, self._grasp_state, self._progress = plan, None, None

    def set_grasp_state(self, grasp_state: GraspState) -> None:
        """Store the controller's state after the newest frame."""
        self._grasp_state = grasp_state

    def show_recorded(
        self, frame: Frame, gripper: GripperState | None, progress: GraspProgress | None
    ) -> None:
        """Send a recorded frame and the grasp's progress, without updating the frame counts."""
        with self._lock:
            self._frames.append((frame, gripper))
            self._progress = progress

    def observe(self, observation: Observation) -> None:
        """Add the frame and gripper state of an observation."""
        self.add_frame(observation.frame, observation.gripper)

    def add_frame(self, frame: Frame, gripper: GripperState | None) -> None:
        """Add a frame with the gripper's state, if any, and update the frame counts."""
        now_s = time.monotonic()
        with self._lock:
            counts = self._frame_counts
            if counts.sequence is not None:
                gap = max(0, frame.sequence - counts.sequence - 1)
                counts.lost += gap if self._counts_gaps else 0
                wall_s = now_s - counts.arrived_s
                old_s = counts.period_s
                self._periods_s.append(wall_s)
                counts.period_s = wall_s if math.isnan(old_s) else 0.9 * old_s + 0.1 * wall_s
            counts.frames += 1
            counts.sequence, counts.arrived_s = frame.sequence, now_s
            self._frames.append((frame, gripper))
            self._recent.append((frame.time_s, frame.sequence))
            while frame.time_s - self._recent[0][0] > _RATE_WINDOW_S:
                self._recent.popleft()

    def _run(self) -> None:
        last = False
        while not last:
            self._send_now.wait(SEND_PERIOD_S)
            self._send_now.clear()
            last = self._closed.is_set()
            try:
                self._send(self.update())
            except OSError:
                self._on_lost()
                return

    def update(self) -> Update:
        """Return the changes since the last update."""
        with self._lock:
            notes, self._notes = tuple(self._notes), []
            frames = list(self._frames)
            self._frames.clear()
            source, plan, grasp_state = self._source, self._plan, self._grasp_state
            link, periods_s = self._link_status(), list(self._periods_s)
        if periods_s:
            p99_s, worst_s = np.quantile(periods_s, [0.99, 1.0])
            link = replace(link, period_p99_s=float(p99_s), period_worst_s=float(worst_s))
        with suppress(OSError):  # the port was just unplugged
            events = self._events()
            link = replace(link, corrupt=events.corrupt, late=events.late)
        progress = self._progress if plan is None else None
        if plan is not None and grasp_state is not None and grasp_state.estimate.frames:
            progress = self._update_progress(grasp_state, plan)
            with self._lock:
                if self._plan is plan:
                    self._progress = progress
        return Update(
            notes=notes,
            link=link,
            frames=None if source is None or not frames else frame_columns(frames, source),
            progress=progress,
        )

    def _update_progress(self, grasp_state: GraspState, plan: Plan) -> GraspProgress:
        """Return the progress of the grasp; the forecast is renewed every `_FORECAST_PERIOD_S`."""
        now_s = time.monotonic()
        fresh = now_s - self._forecast_s >= _FORECAST_PERIOD_S
        if fresh:
            self._forecast_s = now_s
        return grasp_progress_of(grasp_state, plan=plan, before=self._progress, forecasts=fresh)

    def _link_status(self) -> LinkStatus:
        counts, recent = self._frame_counts, self._recent
        age_s = time.monotonic() - counts.arrived_s
        span_s = recent[-1][0] - recent[0][0] if recent else 0.0
        period_s = 0.0 if math.isnan(counts.period_s) else counts.period_s
        return LinkStatus(
            frames=counts.frames,
            lost=counts.lost,
            rate_hz=(recent[-1][1] - recent[0][1]) / span_s if span_s > 0 else math.nan,
            age_s=age_s,
            stale=not age_s <= _STALE.stale_after_s(period_s),
        )


def frame_columns(frames: list[tuple[Frame, GripperState | None]], source: FrameSource) -> Frames:
    """Return frames as columns, with the gripper's width (mm) or pressure (kPa)."""
    states = [state for _, state in frames]
    limits = source.gripper
    reported = [
        math.nan if state is None or limits is None else limits.drive_reading(state)
        for state in states
    ]
    return Frames(
        time_s=np.array([frame.time_s for frame, _ in frames]),
        counts=np.array([frame.counts for frame, _ in frames]),
        oversampling=frames[-1][0].oversampling,
        reported=np.array(reported),
        moving=np.array([state is not None and state.moving for state in states]),
    )
