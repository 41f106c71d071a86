"""The state of the devices, as the device process reports it. This module has no I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from palpate.grasp.document import GraspDocument
from palpate.sensor.health import Health
from palpate_station.dashboard.folder import Interruption
from palpate_station.dashboard.live import Live
from palpate_station.dashboard.messages import (
    ACTIVITIES,
    CalibrateForce,
    CalibrateRest,
    CalibrationRenewed,
    DeviceActivity,
    DevicesLost,
    FrameSource,
    Grasped,
    GraspOrder,
    Guide,
    Measured,
    Note,
    OpenHand,
    OpenRig,
    Order,
    OrderEnded,
    OrderStarted,
    Play,
    Record,
    RecordedSegment,
    RecordingChanged,
    ReplayPosition,
    Timeline,
    Trouble,
    Update,
)
from palpate_station.line.results import NO_ITEM

#: Number of alarms that the pages list.
_MAX_ALARMS = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFailure:
    """A failed calibration; the previous one stays in use."""

    #: Whether a user stopped the calibration.
    stopped: bool
    #: The problem and the remedy.
    reason: str
    #: The last step of the calibration; empty before the first step.
    step: str


class DeviceState:
    """The state of the device process according to its updates.

    Parameters
    ----------
    on_measured, on_grasped : callable
        Called with each measured and each finished grasp and its `GraspOrder`, but not with
        replays.
    """

    def __init__(
        self,
        *,
        on_measured: Callable[[Grasped, GraspOrder], None],
        on_grasped: Callable[[Grasped, GraspOrder], None],
    ) -> None:
        self._on_measured, self._on_grasped = on_measured, on_grasped
        self.activity = DeviceActivity.IDLE
        self.live = Live()
        #: Current instruction for the user.
        self.guide: Guide | None = None
        self._trouble = ""
        #: Time and text of the last alarms, oldest first, and the number of all alarms.
        self.alarms = deque[tuple[datetime, str]](maxlen=_MAX_ALARMS)
        self.alarm_count = 0
        #: Results of the last grasp or replay, calibration and examination.
        self.grasped: Grasped | None = None
        #: The document of the shown grasp with its item and bin; None before the answer.
        self.placed: GraspDocument | None = None
        #: What the bin is based on, and why it is the default bin, as text.
        self.evidence = self.why_default = ""
        #: Whether the hand holds an object with its answer, and its bin if there are rules.
        self.is_answered = False
        #: Whether the last grasp ended because the hold time was over.
        self.is_released_alone = False
        #: Whether the shown grasp belongs to a lot that has ended.
        self.is_past = False
        #: Item of the shown grasp; empty without a name.
        self.item_id = ""
        #: Reason why the shown grasp is not stored; empty if it is, or without a grasp.
        self.not_stored = ""
        #: The grasp that was cut off by the end of a process; None after the next grasp has begun.
        self.interrupted: Interruption | None = None
        self.calibrated: CalibrationRenewed | None = None
        self.health: Health | None = None
        #: Failure of the last order, if it was a calibration.
        self.calibration_failure: CalibrationFailure | None = None
        #: Whether the last order was a grasp that was stopped before the hand moved.
        self.stopped_early = False
        #: Time until the hand received the last stop, on the rig's clock.
        self.stopped_after_s: float | None = None
        #: File of the current recording of frames between orders.
        self.recording: Path | None = None
        self.rig_open = False
        #: The running order; None between orders.
        self.order: Order | None = None

    @property
    def trouble(self) -> str:
        """The last problem; empty after its end or after the start of an order."""
        return self._trouble

    @trouble.setter
    def trouble(self, text: str) -> None:
        if text and text != self._trouble:
            self.add_alarm(text)
        self._trouble = text

    def add_alarm(self, text: str) -> None:
        """Add a problem to the alarms."""
        self.alarms.append((datetime.now(UTC), text))
        self.alarm_count += 1

    @property
    def files_in_use(self) -> set[str]:
        """Names of the recordings that are being written or replayed."""
        match self.order:
            case GraspOrder(recording=file) | Play(file=file):
                return {file.name}
        return set() if self.recording is None else {self.recording.name}

    @property
    def is_sensor_only(self) -> bool:
        """Whether the open rig has no gripper."""
        source = self.live.source
        return source is not None and source.gripper is None and not source.replayed

    def mark_pending(self, order: Order) -> None:
        """Treat an order as started before the devices report it, so it is not repeated."""
        if isinstance(order, Record):
            return
        self.activity, self.guide, self.order = ACTIVITIES[type(order)], None, order

    def apply_update(self, update: Update | DevicesLost) -> None:
        """Apply an update of the device process."""
        if isinstance(update, DevicesLost):
            self.activity, self.trouble = DeviceActivity.GONE, update.text
            self.live.link = replace(self.live.link, stale=True)
            return
        for note in update.notes:
            self._apply_note(note)
        self.live.link = update.link
        if update.progress is not None:
            self.live.set_progress(update.progress)
        if update.frames is not None:
            self.live.add_frames(update.frames)

    def _apply_note(self, note: Note) -> None:
        match note:
            case FrameSource():
                self.live.open_source(note)
                self.rig_open = self.rig_open or not note.replayed
            case OrderStarted():
                self._start_order(note.order)
            case Guide():
                self.guide = note
            case Measured() if isinstance(self.order, GraspOrder):
                self._on_measured(note.grasped, self.order)
            case RecordedSegment():
                self.live.add_frames(note.frames)
                if note.progress is not None:
                    self.live.set_progress(note.progress)
            case Timeline():
                self.live.timeline = note
            case ReplayPosition():
                self.live.playing = note
                self.grasped = note.grasped
            case RecordingChanged():
                self.recording = note.file
            case Trouble():
                self.trouble = note.text
            case OrderEnded():
                self._end_order(note)

    def _start_order(self, order: Order) -> None:
        self.activity, self.order = ACTIVITIES[type(order)], order
        self.guide, self.trouble, self.stopped_after_s = None, "", None
        self.calibration_failure, self.stopped_early = None, False
        if isinstance(order, OpenRig):
            self.rig_open = False
        if isinstance(order, OpenHand):
            self.live.released = True
        if isinstance(order, GraspOrder):
            self.interrupted = None
        if isinstance(order, OpenRig | GraspOrder | Play):
            self.grasped, self.placed, self.is_answered = None, None, False
            self.evidence, self.why_default = "", ""
            self.is_released_alone = self.is_past = False
            self.item_id = order.item_id if isinstance(order, GraspOrder) else ""
            is_unnamed = isinstance(order, GraspOrder) and not order.item_id
            self.not_stored = NO_ITEM if is_unnamed else ""
            self.live.clear_curve()

    def mark_idle(self) -> None:
        """Reset the activity after an order, so that the next order may start."""
        self.activity = DeviceActivity.WATCHING if self.rig_open else DeviceActivity.IDLE
        self.order = None

    def _end_order(self, note: OrderEnded) -> None:
        self.mark_idle()
        failure = self.calibration_failure = self._failure(note)
        self.stopped_early = note.stopped and isinstance(note.order, GraspOrder)
        # A stop requested by the user is not a problem.
        is_requested = self.stopped_early or (failure is not None and failure.stopped)
        self.trouble = "" if is_requested else note.trouble
        self.guide = None
        # A calibration may run on a bench with a different clock.
        self.stopped_after_s = None if failure is not None else note.stopped_after_s
        # Clears the previous grasp, even if this one never started.
        if isinstance(note.order, Play | GraspOrder):
            self.grasped = None
        match note.found:
            case Grasped():
                self.grasped = note.found
                self.is_released_alone = note.found.is_released_alone
                if isinstance(note.order, GraspOrder):
                    self.live.finish_grasp(note.found.document.result.moments)
                    self._on_grasped(note.found, note.order)
            case CalibrationRenewed():
                self.calibrated = note.found
            case Health():
                self.health = note.found

    def _failure(self, note: OrderEnded) -> CalibrationFailure | None:
        if not (isinstance(note.order, CalibrateRest | CalibrateForce) and note.trouble):
            return None
        self.calibrated = None
        return CalibrationFailure(
            stopped=note.stopped,
            reason=note.trouble,
            step="" if self.guide is None else self.guide.text,
        )
