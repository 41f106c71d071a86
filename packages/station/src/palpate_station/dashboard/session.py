"""The reported state of the devices, and the rules for the users of the page.

This module has no I/O. Any viewer may watch and press STOP; all other actions are reserved for the
driver. Another viewer becomes the driver by taking over.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from math import inf
from pathlib import Path
from threading import RLock

from palpate.errors import InputError
from palpate.grasp.document import GraspDocument
from palpate.sensor.health import Health
from palpate_station.dashboard.live import Live
from palpate_station.dashboard.messages import (
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
from palpate_station.dashboard.users import Role, User
from palpate_station.dashboard.words import Words
from palpate_station.line.gs1 import read_label
from palpate_station.line.results import NO_ITEM
from palpate_station.records import Item

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
        #: What the bin is based on, as text.
        self.evidence = ""
        #: Whether the hand holds an object with its answer, and its bin if there are rules.
        self.is_answered = False
        #: Whether the last grasp ended because the hold time was over.
        self.is_released_alone = False
        #: Item of the shown grasp; empty without a name.
        self.item_id = ""
        #: Reason why the shown grasp is not stored; empty if it is, or without a grasp.
        self.not_stored = ""
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
        if isinstance(order, OpenRig | GraspOrder | Play):
            self.grasped, self.placed, self.is_answered = None, None, False
            self.evidence, self.is_released_alone = "", False
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


#: The device process reports 20 times per second; after this silence it counts as hung, seconds.
_MAX_SILENCE_S = 1.0
#: Orders are refused if the last frame is older than this, seconds. A briefly stale link is
#: accepted, because each order checks its own frames.
_MAX_FRAME_AGE_S = 1.0
#: A client of the API or of a line protocol that sends nothing for this time loses control,
#: seconds.
LEASE_S = 5.0
#: Actions of the role `operate`; the others require `configure`.
_OPERATE = (Action.GRASP, Action.RELEASE, Action.RECORD, Action.CONFIRM, Action.SPEED)
_NEEDS_FRAMES = (Action.GRASP, Action.CALIBRATE, Action.EXAMINE)
_NEEDS_OPEN_HAND = (Action.GRASP, Action.EXAMINE)


@dataclass(slots=True)
class GraspForm:
    """Settings of the next grasp, shared by all pages."""

    #: Target grip force; None for a gentle squeeze.
    target_force_n: float | None = None
    #: Name of the item; empty if the grasp is not stored. Each grasp takes the name, so that the
    #: next object is not stored under the same name, and returns it if the same item is to be
    #: grasped again.
    item_id: str = ""
    #: Name of the last grasped item.
    last_item_id: str = ""
    #: Kind of produce, for its damage limit; empty if unknown.
    kind: str = ""
    #: The last grasp ordered with these settings.
    ordered: GraspOrder | None = None
    #: Whether the name is that of the last grasp, returned by it.
    is_returned: bool = False

    @property
    def label_fault(self) -> str:
        """Why the name can't be the name of an item; empty if it can, or without a name."""
        try:
            if self.item_id:
                check_item(self.item_id)
        except InputError as error:
            return str(error)
        return ""

    def set_item(self, text: str) -> None:
        """Set the name that a user has typed or scanned."""
        if text != self.item_id:
            self.item_id, self.is_returned = text, False

    def take_item(self, order: GraspOrder) -> None:
        """Take the name for an ordered grasp."""
        self.last_item_id = self.item_id or self.last_item_id
        self.item_id, self.is_returned, self.ordered = "", False, order

    def return_item(self, order: GraspOrder | None, *, again: bool) -> None:
        """Return the name for another grasp of the item, or withdraw it.

        A name that was typed or scanned since the grasp is retained.
        """
        if order is None or order != self.ordered:
            return
        if again and not self.item_id:
            self.item_id, self.is_returned = self.last_item_id if order.item_id else "", True
        elif not again and self.is_returned:
            self.item_id, self.is_returned = "", False


def check_item(text: str) -> str:
    """Return the item identifier of a typed or scanned text.

    Raises `InputError` if the label is damaged, or the text can't be a name.
    """
    return Item(item_id=read_label(text)).item_id


def page_name(host: str, user: User | None = None) -> str:
    """Return the name of a page's viewer for people.

    >>> page_name("10.0.0.7"), page_name("10.0.0.7", User(name="maria", token="correct-horse"))
    ('the page at 10.0.0.7', 'maria')
    """
    return user.name if user is not None and user.name else f"the page at {host}"


class Session:
    """One rig, many viewers, one driver.

    Parameters
    ----------
    send : callable
        Sends an order or a request to the device process.
    on_measured, on_grasped : callable, optional
        Called with each measured and each finished grasp and its `GraspOrder`, but not with
        replays.
    silent_s : callable, optional
        Returns the time since the last message of the device process, seconds.
    words : Words, optional
        Texts of the pages; English by default.
    requires_item : bool
        Whether a grasp needs the name of its item.
    now_s : callable, optional
        The clock of the leases.
    on_event : callable, optional
        Called with the name of a viewer and what it has done, for the log.

    Examples
    --------
    >>> session = Session(send=print)
    >>> session.join("a", name="the page at 10.0.0.7"), session.join("b"), session.driver
    (True, False, 'a')
    >>> session.order("b", OpenRig(name="sim-rigid"))
    Traceback (most recent call last):
    palpate.errors.InputError: the page at 10.0.0.7 drives; take over first
    """

    def __init__(
        self,
        *,
        send: Callable[[Order | Request], None],
        on_measured: Callable[[Grasped, GraspOrder], None] = lambda grasped, order: None,
        on_grasped: Callable[[Grasped, GraspOrder], None] = lambda grasped, order: None,
        silent_s: Callable[[], float] = lambda: 0.0,
        now_s: Callable[[], float] = time.monotonic,
        on_event: Callable[[str, str], None] = lambda who, what: None,
        words: Words | None = None,
        requires_item: bool = False,
    ) -> None:
        self._send, self._silent_s, self._now_s = send, silent_s, now_s
        self._on_event = on_event
        #: Texts of the pages.
        self.words = words or Words()
        self.requires_item = requires_item
        self.devices = DeviceState(on_measured=on_measured, on_grasped=on_grasped)
        self.viewers: set[str] = set()
        self._driver: str | None = None
        #: Name of each viewer for people.
        self._names = dict[str, str]()
        self._roles = dict[str, Role]()
        #: End of the lease of each client without a connection of its own.
        self._leases_s = dict[str, float]()
        self._viewer_of_tab = dict[str, str]()
        #: Settings of the next grasp.
        self.form = GraspForm()
        #: Target force of the last ordered grasp.
        self.target_force_n: float | None = None
        #: The last requested rig.
        self.rig: OpenRig | None = None
        #: Number of stops by all users.
        self.stops = 0
        #: Guards against stops from another thread. It is held while a stop is sent, and while an
        #: order that must not follow a stop is checked and sent.
        self.stop_lock = RLock()

    @property
    def shown_target_n(self) -> float | None:
        """Target force of the shown grasp: recorded for a replay, else last ordered."""
        progress = self.devices.live.progress
        if self.devices.activity is DeviceActivity.REPLAYING and progress is not None:
            return progress.bounds.target_n
        return self.target_force_n

    # -- control --------------------------------------------------------------------------------

    @property
    def driver(self) -> str | None:
        """The viewer that drives; None without one, or while its lease is over."""
        driver = self._driver
        is_over = driver is not None and self._leases_s.get(driver, inf) < self._now_s()
        return None if is_over else driver

    @property
    def driver_name(self) -> str:
        """Name of the driver for people; empty without a driver."""
        driver = self.driver
        return "" if driver is None else self._names.get(driver, driver)

    def renew(self, client: str) -> None:
        """Extend the lease of a client that has joined with one; others are ignored."""
        if client in self._leases_s:
            self._leases_s[client] = self._now_s() + LEASE_S

    def join(
        self,
        viewer: str,
        *,
        tab: str | None = None,
        name: str = "a page",
        leased: bool = False,
        role: Role = Role.CONFIGURE,
    ) -> bool:
        """Add a viewer; return whether this viewer is the driver, like the first viewer.

        A page reloaded in the same browser tab retains control. A `leased` viewer drives until
        `LEASE_S` after its last `renew`, because nothing else reveals that it has gone. A viewer
        whose `role` may only watch never becomes the driver.

        >>> session = Session(send=print)
        >>> session.join("a", tab="1"), session.join("b", tab="2"), session.join("c", tab="1")
        (True, False, True)
        """
        before = None if tab is None else self._viewer_of_tab.get(tab)
        if tab is not None:
            self._viewer_of_tab[tab] = viewer
            # The server detects the closed connection of the old page only later.
            self.viewers -= {before}
        self.viewers.add(viewer)
        self._names.setdefault(viewer, name)
        self._roles.setdefault(viewer, role)
        if leased:
            self._leases_s[viewer] = self._now_s() + LEASE_S
        if self._roles[viewer].may_drive and self.driver in (None, before):
            self._drive(viewer)
        return self.driver == viewer

    def take_over(self, viewer: str) -> None:
        """Make this viewer the driver, if its role may drive."""
        self.join(viewer)
        if self._roles[viewer].may_drive:
            self._drive(viewer)

    def _drive(self, viewer: str) -> None:
        if self._driver != viewer:
            before = self.driver_name
            self._on_event(self._names[viewer], f"drives{before and f' instead of {before}'}")
        self._driver = viewer

    def leave(self, viewer: str) -> None:
        """Remove a viewer; after the driver leaves, the next to join or take over drives."""
        if self._driver == viewer:
            self._on_event(self._names[viewer], "stops driving")
            self._driver = None
        self.viewers.discard(viewer)
        self._names.pop(viewer, None)
        self._roles.pop(viewer, None)
        self._leases_s.pop(viewer, None)
        self._viewer_of_tab = {
            tab: last for tab, last in self._viewer_of_tab.items() if last != viewer
        }

    # -- permitted actions ----------------------------------------------------------------------

    @property
    def silence_s(self) -> float | None:
        """Time without a message of a hung device process, seconds; None while it reports."""
        silent_s = self._silent_s()
        return silent_s if silent_s > _MAX_SILENCE_S else None

    def refusal(self, action: Action, *, viewer: str) -> str:
        """Return why an action is refused now; empty if it is allowed."""
        activity, guide, words = self.devices.activity, self.devices.guide, self.words
        if activity is DeviceActivity.GONE:
            return words("refusal.gone")
        if self.silence_s is not None:
            return words("refusal.hung")
        if viewer != self.driver:
            if self.driver is None:
                return words("refusal.no_driver")
            return words("refusal.other_driver", name=self.driver_name)
        role = self._roles.get(viewer, Role.CONFIGURE)
        if role is not Role.CONFIGURE and action not in _OPERATE:
            return words("refusal.role", name=self._names[viewer], action=action)
        if action is Action.CONFIRM:
            has_step = guide is not None and guide.needs_confirmation
            return "" if has_step else words("refusal.no_step")
        if action in (Action.SPEED, Action.FILES):
            return ""
        if action is Action.SEEK:
            is_replaying = activity is DeviceActivity.REPLAYING
            return "" if is_replaying else words("refusal.no_replay")
        if action is Action.RELEASE and activity is DeviceActivity.GRASPING:
            return ""
        if activity not in (DeviceActivity.WATCHING, DeviceActivity.IDLE):
            text = words(f"activity.{activity.name.lower()}")
            return words("refusal.busy", activity=text)
        if action in (Action.OPEN, Action.PLAY):
            return ""
        return self._rig_refusal(action)

    def _rig_refusal(self, action: Action) -> str:
        devices, words = self.devices, self.words
        if not devices.rig_open:
            return words("refusal.no_rig")
        if devices.is_sensor_only and action in (Action.GRASP, Action.RELEASE):
            return words("refusal.no_gripper")
        link = devices.live.link
        if action in _NEEDS_FRAMES and link.stale and not link.age_s <= _MAX_FRAME_AGE_S:
            return words("refusal.no_frames")
        if action in _NEEDS_OPEN_HAND and devices.live.is_hand_open is False:
            return words("refusal.closed")
        return ""

    # -- actions --------------------------------------------------------------------------------
    # Refused actions raise `InputError` with the reason.

    def order(self, viewer: str, order: Order) -> None:
        """Send an order of a viewer if it is allowed."""
        self._check(ACTIONS[type(order)], viewer)
        check_ranges(order)
        if self.requires_item and isinstance(order, GraspOrder) and not order.item_id:
            raise InputError(self.words("next.name"))
        self.send_order(order)
        item = f" {order.item_id}" if isinstance(order, GraspOrder) and order.item_id else ""
        self._on_event(self.driver_name, f"{ACTIONS[type(order)]}{item}")

    def send_order(self, order: Order) -> None:
        """Send an order without checking permissions."""
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
        """Stop the running job, for any viewer; return the number of the stop."""
        with self.stop_lock:
            self.stops += 1
            self._send(StopNow(self.stops))
            return self.stops

    def request(self, viewer: str, request: Request) -> None:
        """Send a request to the running job: confirm, speed, seek, pause or release."""
        self._check(ACTIONS[type(request)], viewer)
        check_ranges(request)
        self._send(request)
        if isinstance(request, ReleaseNow):
            self._on_event(self.driver_name, str(Action.RELEASE))
        if isinstance(request, SetSpeed) and self.devices.activity is not DeviceActivity.REPLAYING:
            self.rig = self.rig and replace(self.rig, speed=request.speed)

    def _check(self, action: Action, viewer: str) -> None:
        why = self.refusal(action, viewer=viewer)
        if why:
            raise InputError(why)
