"""The reported state of the devices, and the rules of the page.

No browser, no I/O. Anyone may watch, and anyone may press stop. Everything else is for the one who
drives; another becomes the driver only by taking over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from threading import RLock
from typing import Any

from palpate.dashboard.live import Live
from palpate.dashboard.messages import (
    ACTIONS,
    ACTIVITIES,
    Action,
    CalibrateForce,
    CalibrateRest,
    CalibrationRenewed,
    DeviceActivity,
    DevicesLost,
    FrameSource,
    Grasped,
    GraspOrder,
    Guide,
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
    ReleaseNow,
    ReplayPosition,
    Request,
    SetSpeed,
    StopNow,
    Timeline,
    Trouble,
    Update,
    check_ranges,
)
from palpate.errors import InputError
from palpate.sensor.health import Health


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationFailure:
    """A failed calibration; the previous one stays in use."""

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
        self.activity = DeviceActivity.IDLE
        self.live = Live()
        #: What the user is to do now.
        self.guide: Guide | None = None
        #: The last problem; empty once something went well.
        self.trouble = ""
        #: Results of the last grasp or replay, calibration and examination.
        self.grasped: Grasped | None = None
        #: `bin` and `item` of the grasp on the page; empty without rules and item.
        self.placement: Mapping[str, Any] = {}
        #: Its item; empty without one.
        self.item_id = ""
        self.calibrated: CalibrationRenewed | None = None
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
    def is_sensor_only(self) -> bool:
        """Whether the rig that is watched has no gripper."""
        source = self.live.source
        return source is not None and source.gripper is None and not source.replayed

    def mark_pending(self, order: Order) -> None:
        """Count an order as begun before the devices answer, so that it is not repeated."""
        if isinstance(order, Record):
            return
        self.activity, self.guide, self.order = ACTIVITIES[type(order)], None, order

    def take(self, update: Update | DevicesLost) -> None:
        """Take an update of the devices."""
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
        if isinstance(order, OpenRig | GraspOrder | Play):
            self.grasped, self.placement = None, {}
            self.item_id = order.item_id if isinstance(order, GraspOrder) else ""
            self.live.clear_curve()

    def mark_idle(self) -> None:
        """End the order, so that the next may begin."""
        self.activity = DeviceActivity.WATCHING if self.rig_open else DeviceActivity.IDLE
        self.order = None

    def _end_order(self, note: OrderEnded) -> None:
        self.mark_idle()
        failure = self.calibration_failure = self._failure(note)
        self.stopped_early = note.stopped and isinstance(note.order, GraspOrder)
        # A stop is a wish, and no trouble.
        is_requested = self.stopped_early or (failure is not None and failure.stopped)
        self.trouble = "" if is_requested else note.trouble
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
                    self.live.freeze_curve()
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


#: The devices' process reports twenty times a second; silent for longer than this, it hangs.
_MAX_SILENCE_S = 1.0
#: A link that is late for less than this refuses nothing: every order checks its own frames.
_MAX_FRAME_AGE_S = 1.0
_NEEDS_FRAMES = (Action.GRASP, Action.CALIBRATE, Action.EXAMINE)
_NEEDS_OPEN_HAND = (Action.GRASP, Action.EXAMINE)


@dataclass(slots=True)
class GraspForm:
    """Settings of the next grasp, shared by all pages."""

    #: Grip force to reach; None is a gentle squeeze.
    target_force_n: float | None = None
    #: Name of the item; empty if its grasp is not to be stored. A grasp uses it up: the next object
    #: must not be stored under the name of this one.
    item_id: str = ""
    #: Name of the item that was grasped last.
    last_item_id: str = ""
    #: Kind of produce, for its damage limit; empty if not known.
    kind: str = ""


class Session:
    """One rig, many viewers, one driver.

    Parameters
    ----------
    send : callable
        Takes an order or a request.
    on_grasped : callable, optional
        Called with each finished grasp (not with replays), and its order.
    silent_s : callable, optional
        Returns the time since the devices' process last sent anything, seconds.

    Examples
    --------
    >>> session = Session(send=print)
    >>> session.join("a"), session.join("b"), session.driver
    (True, False, 'a')
    >>> session.order("b", OpenRig(name="sim-rigid"))
    Traceback (most recent call last):
    palpate.errors.InputError: another person drives; take over first
    """

    def __init__(
        self,
        *,
        send: Callable[[Order | Request], None],
        on_grasped: Callable[[Grasped, GraspOrder], None] = lambda grasped, order: None,
        silent_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self._send, self._silent_s = send, silent_s
        self.devices = DeviceState(on_grasped=on_grasped)
        self.viewers: set[str] = set()
        self.driver: str | None = None
        self._viewer_of_tab = dict[str, str]()
        #: Of the next grasp.
        self.form = GraspForm()
        #: Of the last grasp that was ordered.
        self.target_force_n: float | None = None
        #: The rig asked for last.
        self.rig: OpenRig | None = None
        #: How often anyone pressed stop.
        self.stops = 0
        #: Stops come from another thread: held while one is sent, and while an order that must not
        #: begin after a stop is checked and sent.
        self.stop_lock = RLock()

    @property
    def shown_target_n(self) -> float | None:
        """Target force of the shown grasp: the recorded one, else the last ordered."""
        progress = self.devices.live.progress
        if self.devices.activity is DeviceActivity.REPLAYING and progress is not None:
            return progress.bounds.target_n
        return self.target_force_n

    # -- who drives -----------------------------------------------------------------------------

    def join(self, viewer: str, *, tab: str | None = None) -> bool:
        """Add a viewer; return whether they drive, as the first does.

        A page that is loaded again in the same tab of a browser keeps control.

        >>> session = Session(send=print)
        >>> session.join("a", tab="1"), session.join("b", tab="2"), session.join("c", tab="1")
        (True, False, True)
        """
        before = None if tab is None else self._viewer_of_tab.get(tab)
        if tab is not None:
            self._viewer_of_tab[tab] = viewer
            # Its connection is given up only after a while.
            self.viewers -= {before}
        self.viewers.add(viewer)
        if self.driver is None or self.driver == before:
            self.driver = viewer
        return self.driver == viewer

    def take_over(self, viewer: str) -> None:
        """Make this viewer the driver."""
        self.join(viewer)
        self.driver = viewer

    def leave(self, viewer: str) -> None:
        """Remove a viewer; a driver's place stays free until another takes over or joins."""
        self.viewers.discard(viewer)
        self._viewer_of_tab = {
            tab: last for tab, last in self._viewer_of_tab.items() if last != viewer
        }
        if self.driver == viewer:
            self.driver = None

    # -- what may be pressed --------------------------------------------------------------------

    @property
    def silence_s(self) -> float | None:
        """Silence of the devices' process, seconds; None while it reports."""
        silent_s = self._silent_s()
        return silent_s if silent_s > _MAX_SILENCE_S else None

    def refusal(self, action: Action, *, viewer: str) -> str:
        """Return why this can't be pressed now; empty if it can."""
        activity, guide = self.devices.activity, self.devices.guide
        if activity is DeviceActivity.GONE:
            return "the devices are gone: start palpate serve again"
        if self.silence_s is not None:
            return "the devices are silent: if the hand may move, use the emergency stop"
        if viewer != self.driver:
            if self.driver is None:
                return "no one drives; take over first"
            return "another person drives; take over first"
        if action is Action.CONFIRM:
            return "" if guide is not None and guide.needs_confirmation else "nothing is asked"
        if action in (Action.SPEED, Action.FILES):
            return ""
        if action is Action.SEEK:
            return "" if activity is DeviceActivity.REPLAYING else "nothing is replayed"
        if action is Action.RELEASE and activity is DeviceActivity.GRASPING:
            return ""
        if activity not in (DeviceActivity.WATCHING, DeviceActivity.IDLE):
            return f"{activity!s}: wait, or press stop"
        if action in (Action.OPEN, Action.PLAY):
            return ""
        return self._rig_refusal(action)

    def _rig_refusal(self, action: Action) -> str:
        devices = self.devices
        if not devices.rig_open:
            return "no rig is open: choose one"
        if devices.is_sensor_only and action in (Action.GRASP, Action.RELEASE):
            return "this rig has no gripper"
        link = devices.live.link
        if action in _NEEDS_FRAMES and link.stale and not link.age_s <= _MAX_FRAME_AGE_S:
            return "no fresh frames: check the link"
        if action in _NEEDS_OPEN_HAND and devices.live.is_hand_open is False:
            return "the hand is not open: release first"
        return ""

    # -- what is pressed ------------------------------------------------------------------------
    # Each raises `InputError` with the reason if it can't be done now.

    def order(self, viewer: str, order: Order) -> None:
        """Carry out an order of a viewer."""
        self._check(ACTIONS[type(order)], viewer)
        check_ranges(order)
        self.send_order(order)

    def send_order(self, order: Order) -> None:
        """Send an order without a check of the driver."""
        if isinstance(order, GraspOrder):
            self.target_force_n = order.target_force_n
        if isinstance(order, OpenRig):
            self.rig = order
        self.devices.mark_pending(order)
        self._send(order)

    def release(self, viewer: str) -> None:
        """Release the object, or open the hand."""
        if self.devices.activity is DeviceActivity.GRASPING:
            self.request(viewer, ReleaseNow())
        else:
            self.order(viewer, OpenHand())

    def stop(self) -> int:
        """Stop the running job at once, for any viewer; return the number to confirm."""
        with self.stop_lock:
            self.stops += 1
            self._send(StopNow(self.stops))
            return self.stops

    def request(self, viewer: str, request: Request) -> None:
        """Change the running job: confirm a step, set the speed, move or pause the replay."""
        self._check(ACTIONS[type(request)], viewer)
        check_ranges(request)
        self._send(request)
        if isinstance(request, SetSpeed) and self.devices.activity is not DeviceActivity.REPLAYING:
            self.rig = self.rig and replace(self.rig, speed=request.speed)

    def _check(self, action: Action, viewer: str) -> None:
        why = self.refusal(action, viewer=viewer)
        if why:
            raise InputError(why)
