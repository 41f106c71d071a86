"""Data of the page's plots: newest pixels, curve, movements and forecast band."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from palpate.arrays import FloatArray
from palpate.force.of_calibration import HORIZON_S, follow_force
from palpate.force.sheet_follower import SheetFollower
from palpate.grasp.phases import Phase
from palpate.grasp.result import Moment
from palpate.measurement import Measurement, Status
from palpate.sensor.sample import PixelSignals, SampleReader, pixel_resistance_ohm
from palpate.signal.events import ContactState, watch_contact
from palpate.signal.relative import finger_means, mean_change
from palpate_station.dashboard.grasp_progress import GraspProgress
from palpate_station.dashboard.messages import (
    Frames,
    FrameSource,
    LinkStatus,
    ReplayPosition,
    Timeline,
)

#: Maximum density of the curve, points per second, and length of the curve without a grasp,
#: seconds.
POINTS_PER_S, CURVE_S = 50, 90.0
#: The curve of a grasp ends this long after its end was reported, seconds. The page shows 3 s after
#: the release, and a slow machine reports the end late.
_TAIL_S = 10.0
_MAX_MOVES, _MAX_BANDS = 200, 900
#: Changes above this are movements; the noise of widths (mm) and pressures (kPa) is smaller.
_MIN_MOVE = {"width": 0.1, "pressure": 0.4}
#: Averaging time of the measurement at the horizon, seconds (as in `palpate settle`).
_HORIZON_MEAN_S = 0.5
#: Number of first frames that provide the rest values without a calibration.
_REST_FRAMES = 15


@dataclass(frozen=True, slots=True)
class Point:
    """Mean change at one time, with the force of a calibrated, loaded sensor.

    `ohm`, `reported`, `moving` and `touching` are the values in `Live` at this time.
    """

    time_s: float
    percent: float
    force: Measurement | None = None
    ohm: FloatArray = field(default_factory=lambda: np.empty((0, 0)), compare=False)
    reported: float = math.nan
    moving: bool = False
    touching: tuple[int, ...] = ()


@dataclass(frozen=True, slots=True)
class Band:
    """Forecast of settled change and settled force at one time."""

    time_s: float
    low: float
    value: float
    high: float
    force: Measurement | None = None


class Live:
    """Collects the messages of the devices as plot data for the page."""

    def __init__(self) -> None:
        #: Incremented when the curve restarts with another source or grasp.
        self.generation = 0
        #: Timeline and position of a replay; with a timeline the curve is complete.
        self.timeline: Timeline | None = None
        self.playing: ReplayPosition | None = None
        self.link = LinkStatus()
        self.source: FrameSource | None = None
        self.open_source(None)

    def open_source(self, source: FrameSource | None) -> None:
        """Reset the data for another source of frames."""
        self.source = source
        #: The newest frame, shape (rows, cols).
        self.percent: FloatArray | None = None
        self.ohm: FloatArray | None = None
        self.time_s = math.nan
        #: The gripper's last reported width (mm) or pressure (kPa), and whether it moves.
        self.reported, self.moving = math.nan, False
        self.link = LinkStatus()
        fingers = 0 if source is None else source.layout.fingers
        self._contacts = [ContactState()] * fingers
        self._rest_ohm = None if source is None else source.rest_ohm
        #: Whether a release was requested since the start of the last grasp.
        self.released = False
        self.clear_curve()

    def clear_curve(self) -> None:
        """Restart the curve."""
        self.timeline = self.playing = None
        self.generation += 1
        self.curve: deque[Point] = deque(maxlen=int(POINTS_PER_S * CURVE_S))
        #: The curve of the last grasp, retained until the next grasp.
        self.frozen: list[Point] = []
        self._freeze_s = math.inf
        #: Start and end of the fingers' movements; the end is None during a movement.
        self.moves: deque[list[float | None]] = deque(maxlen=_MAX_MOVES)
        self.band: deque[Band] = deque(maxlen=_MAX_BANDS)
        self.progress: GraspProgress | None = None
        #: Start of each phase of the grasp.
        self.phases: list[tuple[float, str]] = []
        self.released = False
        self._force = None
        if self.source is not None and self.source.law is not None:
            rows = self.source.layout.finger_of_row
            self._force = follow_force(self.source.law, finger_of_row=rows)
        self._last_slot = -math.inf
        self._previous_time_s = 0.0

    def finish_grasp(self, moments: Sequence[Moment]) -> None:
        """Show all events of the finished grasp, and extend its curve by `_TAIL_S` seconds.

        The last progress of a grasp is lost if the next update is sent after the end.
        """
        self._freeze_s = self.time_s + _TAIL_S
        if self.progress is not None:
            self.progress = replace(self.progress, moments=tuple(moments))

    def set_progress(self, progress: GraspProgress) -> None:
        """Update the progress of the grasp."""
        if progress.rest_ohm is not None:
            self._rest_ohm = progress.rest_ohm
        before, settled = self.progress, progress.settled
        if before is None or before.phase != progress.phase:
            self.phases.append((progress.time_s, progress.phase))
        self.released = self.released or progress.phase == Phase.RELEASE.value
        fresh = before is None or settled != before.settled
        if (
            self.timeline is None
            and settled is not None
            and fresh
            and math.isfinite(settled.low + settled.high)
        ):
            self.band.append(
                Band(progress.time_s, settled.low, settled.middle, settled.high, progress.settled_n)
            )
        if isinstance(self._force, SheetFollower):
            self._force.gain = progress.gain
        self.progress = progress

    def add_frames(self, frames: Frames) -> None:
        """Add frames; movements use all frames, the curve uses a fraction of them."""
        source = self.source
        if source is None:
            return
        if self._rest_ohm is None:
            ohm = pixel_resistance_ohm(
                frames.counts[:_REST_FRAMES],
                layout=source.layout,
                oversampling=frames.oversampling,
            )
            self._rest_ohm = np.asarray(np.median(ohm, axis=0))
        pixels = SampleReader(source.layout, self._rest_ohm).read_counts(
            frames.counts, oversampling=frames.oversampling
        )
        self.ohm, self.percent = pixels.resistance_ohm[-1], pixels.change_percent[-1]
        self.time_s = float(frames.time_s[-1])
        if self.timeline is not None:
            self.reported, self.moving = float(frames.reported[-1]), bool(frames.moving[-1])
            return
        self._extend(frames, pixels)
        self._contacts = [
            watch_contact(state, mean)[0]
            for state, mean in zip(self._contacts, self.finger_percent(self.percent), strict=True)
        ]
        columns = zip(frames.time_s, frames.reported, frames.moving, strict=True)
        for time_s, reported, moving in columns:
            self._record_movement(float(time_s), reported=float(reported), moving=bool(moving))

    def signals_at(self, ohm: FloatArray) -> PixelSignals | None:
        """Return the signals of these resistances; None without rest values."""
        if self.source is None or self._rest_ohm is None:
            return None
        return SampleReader(self.source.layout, self._rest_ohm).read_ohm(ohm)

    def finger_percent(self, percent: FloatArray | None) -> list[float]:
        """Return the mean change of each finger's pixels; empty before the first frame."""
        if self.source is None or percent is None:
            return []
        fingers = self.source.layout.finger_of_row
        return [float(mean) for mean in finger_means(percent, finger_of_row=fingers)]

    def finger_forces_n(self, force: Measurement | None, ohm: FloatArray | None) -> list[float]:
        """Return each finger's force, newtons; empty without a grip force.

        The grip force is the mean of the fingers' forces, which are sums over their pixels.
        """
        source, pixels = self.source, None if ohm is None else self.signals_at(ohm)
        if source is None or self._force is None or force is None or pixels is None:
            return []
        fingers = np.array(source.layout.finger_of_row)
        parts_n = self._force.split_n(pixels.excess)
        read = [float(parts_n[fingers == one].sum()) for one in np.unique(fingers)]
        mean = sum(read) / len(read)
        return [force.middle * one / mean for one in read] if mean > 0 else []

    @property
    def touching_fingers(self) -> list[int]:
        """Fingers in contact outside a grasp, detected by the controller's rule."""
        return [finger for finger, state in enumerate(self._contacts) if state.is_touching]

    @property
    def is_hand_open(self) -> bool | None:
        """Whether the hand is open and not moving; None if its opening is unknown."""
        return self.is_open(self.reported, moving=self.moving)

    def is_open(self, reported: float, *, moving: bool) -> bool | None:
        """Return whether the hand with this report is open and not moving; None if unknown."""
        limits = None if self.source is None else self.source.gripper
        if limits is None or math.isnan(reported):
            return None
        return not moving and abs(reported - limits.target(0.0)) < 0.02 * limits.span

    def points_after(self, time_s: float) -> list[Point]:
        """Return the points of the curve after a time."""
        if not self.curve or self.curve[-1].time_s <= time_s:
            return []
        return [one for one in chain(self.frozen, self.curve) if one.time_s > time_s]

    @property
    def force(self) -> Measurement | None:
        """The current force; None without a calibration or a frame."""
        if self.playing is None:
            return self.curve[-1].force if self.curve else None
        at = bisect_right(self.curve, self.playing.time_s, key=lambda point: point.time_s)
        return self.curve[max(at - 1, 0)].force if self.curve else None

    @property
    def settled_measurement(self) -> tuple[float, Measurement | None] | None:
        """Mean change (percent) and force, measured at the horizon of the forecast.

        None before the horizon, after a movement during the hold, and without a force.
        """
        progress = self.progress
        if progress is None or progress.settles_s is None or not self.curve:
            return None
        at_s, now_s = progress.settles_s, self.curve[-1].time_s
        now_s = now_s if self.playing is None else self.playing.time_s
        held = [one for one in self.points_after(at_s - _HORIZON_MEAN_S) if one.time_s <= at_s]
        began_s = at_s - HORIZON_S + _HORIZON_MEAN_S
        is_moved = any(since_s and began_s < since_s < at_s for since_s, _ in self.moves)
        if now_s < at_s or is_moved or not held or any(one.force is None for one in held):
            return None
        return sum(one.percent for one in held) / len(held), held[-1].force

    def _extend(self, frames: Frames, pixels: PixelSignals) -> None:
        """Add points to the curve, without a force while the hand is open or opens."""
        mean_percent = np.nan_to_num(mean_change(pixels.change_percent)).tolist()
        hand = zip(frames.reported.tolist(), frames.moving.tolist(), strict=True)
        for at, (time_s, (reported, moving)) in enumerate(
            zip(frames.time_s.tolist(), hand, strict=True)
        ):
            is_unloaded = (self.released and moving) or bool(self.is_open(reported, moving=moving))
            slot = math.floor(time_s * POINTS_PER_S)
            if slot > self._last_slot:
                self._last_slot = slot
                force = self._force_at(
                    time_s,
                    pixels.excess[at],
                    saturated=bool(pixels.saturated[at].any()),
                    lost=bool(pixels.lost[at].any()),
                )
                self.curve.append(
                    Point(
                        time_s,
                        mean_percent[at],
                        None if is_unloaded else force,
                        ohm=pixels.resistance_ohm[at],
                        reported=reported,
                        moving=moving,
                        touching=tuple(self.touching_fingers),
                    )
                )
                if time_s > self._freeze_s:
                    self.frozen, self._freeze_s = list(self.curve), math.inf
                    self.curve.clear()
                    self.curve.append(self.frozen.pop())

    def _force_at(
        self, time_s: float, excess: FloatArray, *, saturated: bool, lost: bool
    ) -> Measurement | None:
        if self._force is None:
            return None
        force = self._force.step(time_s, excess, saturated=saturated, lost=lost)
        return None if force.status is Status.NOT_MEASURED else force

    def _record_movement(self, time_s: float, *, reported: float, moving: bool) -> None:
        """Record movements of the fingers from the reports of successive frames."""
        limits = None if self.source is None else self.source.gripper
        smallest = math.inf if limits is None else _MIN_MOVE[limits.drive]
        since_s, self._previous_time_s = self._previous_time_s, time_s
        stepped = abs(reported - self.reported) > smallest
        self.reported = reported
        if moving and not self.moving:
            self.moves.append([time_s, None])
        elif stepped and not moving and not self.moving:
            self.moves.append([since_s, time_s])
        elif self.moving and not moving and self.moves:
            self.moves[-1][1] = time_s
        self.moving = moving


def finite_or_none(values: Sequence[float] | FloatArray) -> list[float | None]:
    """Return numbers for JSON with None in place of non-finite values."""
    return [float(value) if math.isfinite(value) else None for value in values]
