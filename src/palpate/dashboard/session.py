"""The rules of the page: who drives, and what may be pressed when. No browser, no I/O.

Anyone may look, and anyone may press stop. Everything else is for the one who drives; another
becomes the driver only by taking over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from threading import RLock

from palpate.dashboard.device_state import DeviceState
from palpate.dashboard.messages import Grasped
from palpate.dashboard.orders import (
    ACTIONS,
    Action,
    Activity,
    GraspOrder,
    OpenHand,
    OpenRig,
    Order,
    ReleaseNow,
    Request,
    SetSpeed,
    StopNow,
    check_numbers,
)
from palpate.errors import InputError

#: The devices' process reports twenty times a second; silent for longer than this, it hangs.
_HUNG_S = 1.0
#: A link that is late for less than this refuses nothing: every order looks at its own frames.
_MISSING_S = 1.0
_NEEDS_FRAMES = (Action.GRASP, Action.CALIBRATE, Action.EXAMINE)
_NEEDS_OPEN_HAND = (Action.GRASP, Action.EXAMINE)


@dataclass(slots=True)
class GraspForm:
    """Settings of the next grasp: one for all pages, so that a reload loses nothing."""

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
    palpate.errors.InputError: someone else drives: take over first
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
        self._of_tab = dict[str, str]()
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
        """What the grasp on the page is after: the recorded one, else the last that was ordered."""
        progress = self.devices.live.progress
        if self.devices.activity is Activity.REPLAYING and progress is not None:
            return progress.bounds.target_n
        return self.target_force_n

    # -- who drives -----------------------------------------------------------------------------

    def join(self, viewer: str, *, tab: str | None = None) -> bool:
        """Let someone in; return whether they drive: the first does.

        A page that is loaded again in the same tab of a browser goes on driving.

        >>> session = Session(send=print)
        >>> session.join("a", tab="1"), session.join("b", tab="2"), session.join("c", tab="1")
        (True, False, True)
        """
        before = None if tab is None else self._of_tab.get(tab)
        if tab is not None:
            self._of_tab[tab] = viewer
            # Its connection is given up only after a while.
            self.viewers -= {before}
        self.viewers.add(viewer)
        if self.driver is None or self.driver == before:
            self.driver = viewer
        return self.driver == viewer

    def take_over(self, viewer: str) -> None:
        """Let this viewer drive, whoever did before."""
        self.join(viewer)
        self.driver = viewer

    def leave(self, viewer: str) -> None:
        """Let someone go; nobody drives then until somebody takes over or comes in."""
        self.viewers.discard(viewer)
        self._of_tab = {tab: last for tab, last in self._of_tab.items() if last != viewer}
        if self.driver == viewer:
            self.driver = None

    # -- what may be pressed --------------------------------------------------------------------

    @property
    def hung_s(self) -> float | None:
        """How long the devices' process has been silent; None while it reports."""
        silent_s = self._silent_s()
        return silent_s if silent_s > _HUNG_S else None

    def refusal(self, action: Action, *, viewer: str) -> str:
        """Return why this can't be pressed now; empty if it can."""
        activity, guide = self.devices.activity, self.devices.guide
        if activity is Activity.GONE:
            return "the devices are gone: start palpate serve again"
        if self.hung_s is not None:
            return "the devices are silent: if the hand may move, use the emergency stop"
        if viewer != self.driver:
            if self.driver is None:
                return "nobody drives: take over first"
            return "someone else drives: take over first"
        if action is Action.CONFIRM:
            return "" if guide is not None and guide.asks else "nothing is asked"
        if action in (Action.SPEED, Action.FILES):
            return ""
        if action is Action.STEER:
            return "" if activity is Activity.REPLAYING else "nothing is replayed"
        if action is Action.RELEASE and activity is Activity.GRASPING:
            return ""
        if activity not in (Activity.WATCHING, Activity.IDLE):
            return f"{activity!s}: wait, or press stop"
        if action in (Action.OPEN, Action.PLAY):
            return ""
        return self._rig_not_ready(action)

    def _rig_not_ready(self, action: Action) -> str:
        devices = self.devices
        if not devices.rig_open:
            return "no rig is open: choose one"
        if devices.sensor_alone and action in (Action.GRASP, Action.RELEASE):
            return "this rig has no gripper"
        link = devices.live.link
        if action in _NEEDS_FRAMES and link.stale and not link.age_s <= _MISSING_S:
            return "no fresh frames: check the link"
        if action in _NEEDS_OPEN_HAND and devices.live.open_hand is False:
            return "the hand is not open: release first"
        return ""

    # -- what is pressed ------------------------------------------------------------------------
    # Each raises `InputError` with the reason if it can't be done now.

    def order(self, viewer: str, order: Order) -> None:
        """Carry out an order of a viewer."""
        self._check(ACTIONS[type(order)], viewer)
        check_numbers(order)
        if isinstance(order, GraspOrder):
            self.target_force_n = order.target_force_n
        if isinstance(order, OpenRig):
            self.rig = order
        self.devices.expect(order)
        self._send(order)

    def open_first(self, order: OpenRig) -> None:
        """Open a rig before anyone is there to order it."""
        self.rig = order
        self.devices.expect(order)
        self._send(order)

    def release(self, viewer: str) -> None:
        """Give the object back, or open the hand."""
        if self.devices.activity is Activity.GRASPING:
            self.request(viewer, ReleaseNow())
        else:
            self.order(viewer, OpenHand())

    def stop(self) -> int:
        """Stop what runs, at once, whoever asks; return the number by which it is confirmed."""
        with self.stop_lock:
            self.stops += 1
            self._send(StopNow(self.stops))
            return self.stops

    def request(self, viewer: str, request: Request) -> None:
        """Change what runs: confirm a step, set the speed, move or pause the replay."""
        self._check(ACTIONS[type(request)], viewer)
        check_numbers(request)
        self._send(request)
        if isinstance(request, SetSpeed) and self.devices.activity is not Activity.REPLAYING:
            self.rig = self.rig and replace(self.rig, speed=request.speed)

    def _check(self, action: Action, viewer: str) -> None:
        why = self.refusal(action, viewer=viewer)
        if why:
            raise InputError(why)
