"""The rules of the page: who drives, what runs, and what may be pressed when. No browser, no I/O.

Anyone may look, and anyone may press stop. Everything else is for the one who drives; another
becomes the driver only by taking over.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from enum import StrEnum
from pathlib import Path

from palpate.dashboard.language import Message
from palpate.dashboard.live import Live
from palpate.dashboard.messages import (
    Began,
    BeingRecorded,
    Calibrated,
    CalibrateForce,
    CalibrateRest,
    Confirm,
    Ended,
    Examine,
    FrameSource,
    Grasped,
    GraspOrder,
    Guide,
    Lost,
    Note,
    OpenHand,
    OpenRig,
    Order,
    Past,
    Pause,
    Play,
    Playing,
    Record,
    ReleaseNow,
    Seek,
    SetSpeed,
    StopNow,
    Stopped,
    Timeline,
    Trouble,
    Update,
    Urgent,
)
from palpate.errors import InputError
from palpate.sensor.health import Health


class Activity(StrEnum):
    """What the devices are doing."""

    IDLE = "no rig"
    OPENING = "opening the rig"
    WATCHING = "watching"
    GRASPING = "grasping"
    RELEASING = "opening the hand"
    RESTING = "calibrating rest"
    WEIGHING = "calibrating force"
    EXAMINING = "examining"
    REPLAYING = "replaying"
    GONE = "gone"


class Action(StrEnum):
    """What can be pressed, apart from stop."""

    OPEN = "open a rig"
    GRASP = "grasp"
    RELEASE = "release"
    CALIBRATE = "calibrate"
    EXAMINE = "examine"
    PLAY = "replay"
    RECORD = "record"
    CONFIRM = "confirm"
    SPEED = "change the speed"
    STEER = "move the replay"
    FILES = "rename or delete"


_ACTIVITIES: dict[type[Order], Activity] = {
    OpenRig: Activity.OPENING,
    GraspOrder: Activity.GRASPING,
    OpenHand: Activity.RELEASING,
    CalibrateRest: Activity.RESTING,
    CalibrateForce: Activity.WEIGHING,
    Examine: Activity.EXAMINING,
    Play: Activity.REPLAYING,
}
_ACTIONS: dict[type[Order], Action] = {
    OpenRig: Action.OPEN,
    GraspOrder: Action.GRASP,
    OpenHand: Action.RELEASE,
    CalibrateRest: Action.CALIBRATE,
    CalibrateForce: Action.CALIBRATE,
    Examine: Action.EXAMINE,
    Play: Action.PLAY,
    Record: Action.RECORD,
}
#: The devices' process speaks twenty times a second; silent for so long, it hangs.
_HUNG_S = 1.0
_NEEDS_OPEN_HAND = (Action.GRASP, Action.EXAMINE)


class Session:
    """One rig, many viewers, one driver.

    Parameters
    ----------
    send : callable
        Takes an order, or a request that is heard at once.
    on_grasped : callable, optional
        Called with each finished grasp (not with replays), and its order.
    silent_s : callable, optional
        Returns how long ago the devices' process said anything, seconds.

    Attributes
    ----------
    driver : str or None
        Who drives.
    activity : Activity
        What runs.
    live : Live
        What is to be drawn.
    guide : Guide or None
        What the user is to do now.
    trouble : str
        What went wrong last; empty once something went well.
    grasped, calibrated, health
        What came of the last grasp or replay, calibration and examination.
    stopped_after_s : float or None
        How long the last stop took, on the rig's clock.
    stops_confirmed : int
        Number of the newest stop of which the devices' process said that the hand was told.
    recording : Path or None
        What is watched goes there.
    rig : OpenRig or None
        The rig asked for last.

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
        send: Callable[[Order | Urgent], None],
        on_grasped: Callable[[Grasped, GraspOrder], None] = lambda grasped, order: None,
        silent_s: Callable[[], float] = lambda: 0.0,
    ) -> None:
        self._send, self._on_grasped, self._silent_s = send, on_grasped, silent_s
        self.viewers: set[str] = set()
        self.driver: str | None = None
        self.activity = Activity.IDLE
        self.live = Live()
        self.guide: Guide | None = None
        self.trouble = ""
        self.target_force_n: float | None = None
        self.grasped: Grasped | None = None
        self.calibrated: Calibrated | None = None
        self.health: Health | None = None
        self.stopped_after_s: float | None = None
        self.stops_confirmed = 0
        self._stops = 0
        self.recording: Path | None = None
        self.rig: OpenRig | None = None
        self._opened = False
        self._file: Path | None = None

    # -- who drives -----------------------------------------------------------------------------

    def join(self, viewer: str) -> bool:
        """Let someone in; return whether they drive: the first does."""
        self.viewers.add(viewer)
        if self.driver is None:
            self.driver = viewer
        return self.driver == viewer

    def take_over(self, viewer: str) -> None:
        """Let this viewer drive, whoever did before."""
        self.join(viewer)
        self.driver = viewer

    def leave(self, viewer: str) -> None:
        """Let someone go; nobody drives then until somebody takes over or comes in."""
        self.viewers.discard(viewer)
        if self.driver == viewer:
            self.driver = None

    @property
    def hung_s(self) -> float | None:
        """How long the devices' process has been silent; None while it speaks."""
        silent_s = self._silent_s()
        return silent_s if silent_s > _HUNG_S else None

    @property
    def files_in_use(self) -> set[str]:
        """Names of the recordings that are being written or shown."""
        return {file.name for file in (self.recording, self._file) if file is not None}

    # -- what may be pressed --------------------------------------------------------------------

    def refusal(self, action: Action, *, viewer: str) -> str:
        """Return why this can't be pressed now; empty if it can."""
        if self.activity is Activity.GONE:
            return Message("the devices are gone: start palpate serve again")
        if self.hung_s is not None:
            return Message("the devices are silent: if the hand may move, use the emergency stop")
        if viewer != self.driver:
            if self.driver is None:
                return Message("nobody drives: take over first")
            return Message("someone else drives: take over first")
        if action is Action.CONFIRM:
            return "" if self.guide is not None and self.guide.asks else Message("nothing is asked")
        if action in (Action.SPEED, Action.FILES):
            return ""
        if action is Action.STEER:
            return "" if self.activity is Activity.REPLAYING else Message("nothing is replayed")
        if action is Action.RELEASE and self.activity is Activity.GRASPING:
            return ""
        if self.activity not in (Activity.WATCHING, Activity.IDLE):
            return Message("{activity}: wait, or press stop", activity=Message(self.activity))
        if action in (Action.OPEN, Action.PLAY):
            return ""
        if not self._opened:
            return Message("no rig is open: choose one")
        return self._not_ready(action)

    @property
    def sensor_alone(self) -> bool:
        """Whether the rig that is watched has no gripper."""
        source = self.live.source
        return source is not None and source.gripper is None and not source.replayed

    def _not_ready(self, action: Action) -> str:
        if self.sensor_alone and action in (Action.GRASP, Action.RELEASE):
            return Message("this rig has no gripper")
        if action in (Action.GRASP, Action.CALIBRATE, Action.EXAMINE) and self.live.pulse.stale:
            return Message("no fresh frames: look at the link")
        if action in _NEEDS_OPEN_HAND and self.live.open_hand is False:
            return Message("the hand is not open: release first")
        return ""

    # -- what is pressed ------------------------------------------------------------------------

    def order(self, viewer: str, order: Order) -> None:
        """Carry out an order of a viewer.

        Raises
        ------
        InputError
            If it can't be carried out now; says why.
        """
        self._check(_ACTIONS[type(order)], viewer)
        if isinstance(order, GraspOrder):
            self.target_force_n = order.target_force_n
        if isinstance(order, OpenRig):
            self.rig = order
        if not isinstance(order, Record):
            # Before the devices answer: a second press must not order it twice.
            self.activity, self.guide = _ACTIVITIES[type(order)], None
            self._file = _file_of(order)
        self._send(order)

    def open_first(self, order: OpenRig) -> None:
        """Open a rig before anyone is there to order it."""
        self.rig, self.activity = order, Activity.OPENING
        self._send(order)

    def release(self, viewer: str) -> None:
        """Give the object back, or open the hand.

        Raises
        ------
        InputError
            If that is not possible now; says why.
        """
        if self.activity is Activity.GRASPING:
            self._check(Action.RELEASE, viewer)
            self._send(ReleaseNow())
        else:
            self.order(viewer, OpenHand())

    def confirm(self, viewer: str) -> None:
        """Say that what a guided step asked for is done.

        Raises
        ------
        InputError
            If nothing was asked of this viewer.
        """
        self._check(Action.CONFIRM, viewer)
        self._send(Confirm())

    def set_speed(self, viewer: str, speed: float) -> None:
        """Let simulated time run so many times as fast as the clock on the wall.

        Raises
        ------
        InputError
            If this viewer doesn't drive.
        """
        self._check(Action.SPEED, viewer)
        if self.rig is not None and self.activity is not Activity.REPLAYING:
            self.rig = replace(self.rig, speed=speed)
        self._send(SetSpeed(speed))

    def seek(self, viewer: str, time_s: float) -> None:
        """Show the replay from this time of the recording on.

        Raises
        ------
        InputError
            If nothing is replayed, or this viewer doesn't drive.
        """
        self._check(Action.STEER, viewer)
        self._send(Seek(time_s))

    def pause(self, viewer: str, *, paused: bool) -> None:
        """Let the replay stand still, or go on.

        Raises
        ------
        InputError
            As `seek`.
        """
        self._check(Action.STEER, viewer)
        self._send(Pause(paused))

    def stop(self) -> int:
        """Stop what runs, at once, whoever asks; return the number by which it is confirmed."""
        self._stops += 1
        self._send(StopNow(self._stops))
        return self._stops

    def _check(self, action: Action, viewer: str) -> None:
        why = self.refusal(action, viewer=viewer)
        if why:
            raise InputError(why)

    # -- what comes from the devices ------------------------------------------------------------

    def take(self, update: Update | Lost) -> None:
        """Take an update of the devices."""
        if isinstance(update, Lost):
            self.activity, self.trouble = Activity.GONE, update.text
            self.live.pulse = replace(self.live.pulse, stale=True)
            return
        for note in update.notes:
            self._take_note(note)
        self.live.pulse = update.pulse
        if update.thought is not None:
            self.live.think(update.thought)
        if update.frames is not None:
            self.live.add(update.frames)

    def _take_note(self, note: Note) -> None:
        match note:
            case FrameSource():
                self.live.begin(note)
                self._opened = self._opened or not note.replayed
            case Began():
                self._begin(note.order)
            case Guide():
                self.guide = note
            case Grasped():
                self.grasped = note
            case Past():
                self.live.recall(note)
            case Timeline():
                self.live.unfold(note)
            case Playing():
                self.live.play(note)
                self.grasped = note.grasped
            case BeingRecorded():
                self.recording = note.file
            case Stopped():
                self.stops_confirmed = max(self.stops_confirmed, note.number)
            case Trouble():
                self.trouble = note.text
            case Ended():
                self._end(note)

    def _begin(self, order: Order) -> None:
        self.activity = _ACTIVITIES[type(order)]
        self.guide, self.trouble, self.stopped_after_s = None, "", None
        if isinstance(order, OpenRig):
            self._opened = False
        if isinstance(order, OpenRig | GraspOrder | Play):
            self.grasped = None
            self.live.clear()

    def _end(self, note: Ended) -> None:
        self.activity = Activity.WATCHING if self._opened else Activity.IDLE
        self.guide, self.trouble = None, note.trouble
        self.stopped_after_s = note.stopped_after_s
        self._file = None
        if isinstance(note.order, Play):
            self.grasped = None
        match note.found:
            case Grasped():
                self.grasped = note.found
                if isinstance(note.order, GraspOrder):
                    self._on_grasped(note.found, note.order)
            case Calibrated():
                self.calibrated = note.found
            case Health():
                self.health = note.found


def _file_of(order: Order) -> Path | None:
    match order:
        case GraspOrder():
            return order.recording
        case Play():
            return order.file
    return None
