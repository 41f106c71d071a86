"""The rules for the users of the pages: who may do what, and when.

This module has no I/O. Any viewer may watch and press STOP; all other actions are reserved for the
driver. Another viewer becomes the driver by taking over.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from math import inf
from threading import RLock

from palpate.errors import InputError
from palpate_station.dashboard.device_state import DeviceState
from palpate_station.dashboard.grasp_form import GraspForm
from palpate_station.dashboard.messages import (
    ACTIONS,
    Action,
    DeviceActivity,
    Grasped,
    GraspOrder,
    OpenHand,
    OpenRig,
    Order,
    ReleaseNow,
    Request,
    SetSpeed,
    StopNow,
    check_ranges,
)
from palpate_station.dashboard.users import Role, User
from palpate_station.dashboard.words import Words
from palpate_station.line.gs1 import LabelError

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


def page_name(host: str, user: User | None = None) -> str:
    """Return the name of a page's viewer for people.

    >>> page_name("10.0.0.7"), page_name("10.0.0.7", User(name="maria", token="correct-horse"))
    ('the page at 10.0.0.7', 'maria')
    """
    return user.name if user is not None and user.name else f"the page at {host}"


def describe_order(order: Order) -> str:
    """Return what an order does, and its item, as text for the log."""
    item = f" {order.item_id}" if isinstance(order, GraspOrder) and order.item_id else ""
    return f"{ACTIONS[type(order)]}{item}"


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
    bins : sequence of str, optional
        The bins of the sorting rules in their order, the default bin last.
    disk_refusal : callable, optional
        Returns why no grasp can be recorded; empty if it can.
    now_s : callable, optional
        The clock of the leases.
    on_event : callable, optional
        Called with the name of a viewer and what it has done, for the log.
    on_refused : callable, optional
        Called with the name of a viewer and what its role has not allowed.

    Examples
    --------
    >>> session = Session(send=print)
    >>> session.join("a", name="the page at 10.0.0.7"), session.claim("a"), session.join("b")
    (False, True, False)
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
        on_refused: Callable[[str, str], None] = lambda who, what: None,
        words: Words | None = None,
        requires_item: bool = False,
        bins: Sequence[str] = (),
        disk_refusal: Callable[[], str] = lambda: "",
    ) -> None:
        self._send, self._silent_s, self._now_s = send, silent_s, now_s
        self._on_event, self._on_refused = on_event, on_refused
        #: Texts of the pages.
        self.words = words or Words()
        self.requires_item, self.bins = requires_item, tuple(bins)
        self._disk_refusal = disk_refusal
        self.devices = DeviceState(on_measured=on_measured, on_grasped=on_grasped)
        self.viewers: set[str] = set()
        self._driver: str | None = None
        #: Name of each viewer for people.
        self._names = dict[str, str]()
        self._roles = dict[str, Role]()
        #: End of the lease of each client without a connection of its own.
        self._leases_s = dict[str, float]()
        self._viewer_of_tab = dict[str, str]()
        #: Pages without a connection, which may return.
        self._away = set[str]()
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
        """Add a viewer; return whether this viewer is the driver.

        A viewer becomes the driver with its first accepted action while nobody drives: a page that
        is only open keeps no line from driving. A page reloaded in the same browser tab retains
        control, and so does a person (by `name`) who has closed the page that drove. A `leased`
        viewer drives until `LEASE_S` after its last `renew`, because nothing else reveals that it
        has gone. A viewer whose `role` may only watch never drives.

        >>> session = Session(send=print)
        >>> session.join("a", tab="1"), session.claim("a"), session.join("b", tab="1")
        (False, True, True)
        """
        before = None if tab is None else self._viewer_of_tab.get(tab)
        if tab is not None:
            self._viewer_of_tab[tab] = viewer
            # The server detects the closed connection of the old page only later.
            self.viewers -= {before}
        self.viewers.add(viewer)
        self._names.setdefault(viewer, name)
        self._roles.setdefault(viewer, role)
        self._away.discard(viewer)
        if leased:
            self._leases_s[viewer] = self._now_s() + LEASE_S
        driver = self.driver
        is_same = driver in self._away and self.driver_name == self._names[viewer]
        is_same |= before is not None and driver == before
        if is_same and self._roles[viewer].may_drive:
            self._drive(viewer)
        return self.driver == viewer

    def may_act(self, viewer: str) -> bool:
        """Return whether a viewer drives, or may because nobody does."""
        return self.driver == viewer or (self.driver is None and self.may_drive(viewer))

    def may_drive(self, viewer: str) -> bool:
        """Return whether the role of a viewer may move the hand."""
        return self._roles.get(viewer, Role.CONFIGURE).may_drive

    def claim(self, viewer: str) -> bool:
        """Make a viewer that acts the driver if nobody drives; return whether it is the driver."""
        if self.driver is None and self.may_act(viewer):
            self.take_over(viewer)
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

    def mark_away(self, viewer: str) -> None:
        """Note that a page has lost its connection: it is closed, or returns soon."""
        self._away.add(viewer)

    def leave(self, viewer: str) -> None:
        """Remove a viewer; after the driver leaves, the next to act or take over drives."""
        if self._driver == viewer:
            self._on_event(self._names[viewer], "stops driving")
            self._driver = None
        self.viewers.discard(viewer)
        self._away.discard(viewer)
        self._names.pop(viewer, None)
        self._roles.pop(viewer, None)
        self._leases_s.pop(viewer, None)
        self._viewer_of_tab = {
            tab: last for tab, last in self._viewer_of_tab.items() if last != viewer
        }

    @property
    def name_fault(self) -> str:
        """Why the next item has no clear name, and what to do; empty if a grasp may take it."""
        form, fault = self.form, self.form.label_fault
        if fault is not None:
            return self.words(fault.step if isinstance(fault, LabelError) else "next.label")
        is_missing = self.requires_item and not form.item_id
        return self.words("next.name") if is_missing else form.find_doubt(self.words)

    # -- permitted actions ----------------------------------------------------------------------

    @property
    def silence_s(self) -> float | None:
        """Time without a message of a hung device process, seconds.

        None while it reports, and after its end.
        """
        silent_s, is_gone = self._silent_s(), self.devices.activity is DeviceActivity.GONE
        return silent_s if silent_s > _MAX_SILENCE_S and not is_gone else None

    @property
    def not_ready(self) -> str:
        """Why the rig can't grasp, whoever orders it; empty if it can, or during a job."""
        if why := self._devices_refusal():
            return why
        is_waiting = self.devices.activity in (DeviceActivity.WATCHING, DeviceActivity.IDLE)
        return self._rig_refusal(Action.GRASP) if is_waiting else ""

    def _devices_refusal(self) -> str:
        if self.devices.activity is DeviceActivity.GONE:
            return self.words("refusal.gone")
        return "" if self.silence_s is None else self.words("refusal.hung")

    def refusal(self, action: Action, *, viewer: str) -> str:
        """Return why an action is refused now; empty if it is allowed."""
        activity, guide, words = self.devices.activity, self.devices.guide, self.words
        if why := self._devices_refusal():
            return why
        if why := self._role_refusal(action, viewer=viewer):
            return why
        if not self.may_act(viewer):
            if self.driver is None:
                return words("refusal.no_driver")
            return words("refusal.other_driver", name=self.driver_name)
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

    def _role_refusal(self, action: Action, *, viewer: str) -> str:
        if not self.may_drive(viewer):
            return self.words("refusal.view", name=self._names[viewer])
        role = self._roles.get(viewer, Role.CONFIGURE)
        if role is not Role.CONFIGURE and action not in _OPERATE:
            return self.words("refusal.role", name=self._names[viewer], action=action)
        return ""

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
        source = devices.live.source
        if action is Action.GRASP and source is not None and source.law is None:
            return words("refusal.no_calibration")
        return self._disk_refusal() if action is Action.GRASP else ""

    # -- actions --------------------------------------------------------------------------------
    # Refused actions raise `InputError` with the reason.

    def order(self, viewer: str, order: Order) -> None:
        """Send an order of a viewer if it is allowed."""
        self.check(ACTIONS[type(order)], viewer)
        check_ranges(order)
        if self.requires_item and isinstance(order, GraspOrder) and not order.item_id:
            self.form.is_refused = True
            raise InputError(self.words("next.name"))
        self.claim(viewer)
        self.send_order(order)
        self._on_event(self.driver_name, describe_order(order))

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
        self.check(ACTIONS[type(request)], viewer)
        check_ranges(request)
        self.claim(viewer)
        self._send(request)
        if isinstance(request, ReleaseNow):
            self._on_event(self.driver_name, str(Action.RELEASE))
        if isinstance(request, SetSpeed) and self.devices.activity is not DeviceActivity.REPLAYING:
            self.rig = self.rig and replace(self.rig, speed=request.speed)

    def check(self, action: Action, viewer: str) -> None:
        """Refuse an action that is not allowed now."""
        if self._role_refusal(action, viewer=viewer):
            self._on_refused(self._names[viewer], f"{action}, role {self._roles[viewer]}")
        if why := self.refusal(action, viewer=viewer):
            raise InputError(why)
