"""The devices as the page knows them: what they last reported, and what came of each order."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from palpate.dashboard.live import Live
from palpate.dashboard.messages import (
    Began,
    BeingRecorded,
    Calibrated,
    DevicesLost,
    Ended,
    FrameSource,
    Grasped,
    Guide,
    Note,
    Playing,
    RecordedStretch,
    Timeline,
    Trouble,
    Update,
)
from palpate.dashboard.orders import (
    ACTIVITIES,
    Activity,
    CalibrateForce,
    CalibrateRest,
    GraspOrder,
    OpenHand,
    OpenRig,
    Order,
    Play,
    Record,
)
from palpate.sensor.health import Health


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFailure:
    """A calibration that made nothing; the one before it stays in use."""

    #: Whether a user stopped it.
    stopped: bool
    #: Why it failed, and what to do.
    reason: str
    #: What it last asked for or did; empty if it did not come to that.
    step: str


class DeviceState:
    """Follows the devices' process by its updates.

    Parameters
    ----------
    on_grasped : callable
        Called with each finished grasp (not with replays), and its order.
    """

    def __init__(self, *, on_grasped: Callable[[Grasped, GraspOrder], None]) -> None:
        self._on_grasped = on_grasped
        self.activity = Activity.IDLE
        self.live = Live()
        #: What the user is to do now.
        self.guide: Guide | None = None
        #: The last problem; empty once something went well.
        self.trouble = ""
        #: Results of the last grasp or replay, calibration and examination.
        self.grasped: Grasped | None = None
        #: `bin` and `item` of the grasp on the page; empty without rules and item.
        self.placed: Mapping[str, Any] = {}
        #: Its item; empty without one.
        self.item_id = ""
        self.calibrated: Calibrated | None = None
        self.health: Health | None = None
        #: Of the last order, if it was a calibration that was stopped or failed.
        self.calibration_failure: CalibrationFailure | None = None
        #: Whether the last order was a grasp that was stopped before it began to move the hand.
        self.stopped_early = False
        #: Duration of the last stop, on the rig's clock.
        self.stopped_after_s: float | None = None
        #: File to which the watched frames go.
        self.recording: Path | None = None
        self.rig_open = False
        #: What is being carried out; None while the rig is only watched.
        self.order: Order | None = None

    @property
    def files_in_use(self) -> set[str]:
        """Names of the recordings that are being written or shown."""
        match self.order:
            case GraspOrder(recording=file) | Play(file=file):
                return {file.name}
        return set() if self.recording is None else {self.recording.name}

    @property
    def sensor_alone(self) -> bool:
        """Whether the rig that is watched has no gripper."""
        source = self.live.source
        return source is not None and source.gripper is None and not source.replayed

    def expect(self, order: Order) -> None:
        """Count an order as begun before the devices answer: a second press must not repeat it."""
        if isinstance(order, Record):
            return
        self.activity, self.guide, self.order = ACTIVITIES[type(order)], None, order

    def take(self, update: Update | DevicesLost) -> None:
        """Take an update of the devices."""
        if isinstance(update, DevicesLost):
            self.activity, self.trouble = Activity.GONE, update.text
            self.live.link = replace(self.live.link, stale=True)
            return
        for note in update.notes:
            self._take_note(note)
        self.live.link = update.link
        if update.progress is not None:
            self.live.take_progress(update.progress)
        if update.frames is not None:
            self.live.add_frames(update.frames)

    def _take_note(self, note: Note) -> None:
        match note:
            case FrameSource():
                self.live.open_source(note)
                self.rig_open = self.rig_open or not note.replayed
            case Began():
                self._begin(note.order)
            case Guide():
                self.guide = note
            case Grasped():
                self.grasped = note
            case RecordedStretch():
                self.live.add_stretch(note)
            case Timeline():
                self.live.set_timeline(note)
            case Playing():
                self.live.set_playing(note)
                self.grasped = note.grasped
            case BeingRecorded():
                self.recording = note.file
            case Trouble():
                self.trouble = note.text
            case Ended():
                self._end(note)

    def _begin(self, order: Order) -> None:
        self.activity, self.order = ACTIVITIES[type(order)], order
        self.guide, self.trouble, self.stopped_after_s = None, "", None
        self.calibration_failure, self.stopped_early = None, False
        if isinstance(order, OpenRig):
            self.rig_open = False
        if isinstance(order, OpenHand):
            self.live.released = True
        if isinstance(order, OpenRig | GraspOrder | Play):
            self.grasped, self.placed = None, {}
            self.item_id = order.item_id if isinstance(order, GraspOrder) else ""
            self.live.clear_curve()

    def rest(self) -> None:
        """Take the order as ended: the next may begin."""
        self.activity = Activity.WATCHING if self.rig_open else Activity.IDLE
        self.order = None

    def _end(self, note: Ended) -> None:
        self.rest()
        failure = self.calibration_failure = self._failure(note)
        self.stopped_early = note.stopped and isinstance(note.order, GraspOrder)
        # A stop is a wish, and no trouble.
        wished = self.stopped_early or (failure is not None and failure.stopped)
        self.trouble = "" if wished else note.trouble
        self.guide = None
        # A calibration may run on the clock of a bench of its own.
        self.stopped_after_s = None if failure is not None else note.stopped_after_s
        # Of the grasp before, if this one never began.
        if isinstance(note.order, Play | GraspOrder):
            self.grasped = None
        match note.found:
            case Grasped():
                self.grasped = note.found
                if isinstance(note.order, GraspOrder):
                    self.live.end_grasp()
                    self._on_grasped(note.found, note.order)
            case Calibrated():
                self.calibrated = note.found
            case Health():
                self.health = note.found

    def _failure(self, note: Ended) -> CalibrationFailure | None:
        if not (isinstance(note.order, CalibrateRest | CalibrateForce) and note.trouble):
            return None
        self.calibrated = None
        return CalibrationFailure(
            stopped=note.stopped,
            reason=note.trouble,
            step="" if self.guide is None else self.guide.text,
        )
