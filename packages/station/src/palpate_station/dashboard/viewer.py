"""A browser's view of the session: actions, refusals, refreshes and page elements."""

from __future__ import annotations

import html
import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import Literal, TypeVar

from nicegui import ui
from nicegui.elements.mixins.disableable_element import DisableableElement

from palpate.errors import InputError
from palpate_station.dashboard.messages import ACTIONS, Action, Order, Request
from palpate_station.dashboard.session import Session

_Value = TypeVar("_Value")
#: Presses that move the hand are refused if they arrive later than this, seconds; a slow server may
#: delay a press by one or two seconds.
_MAX_PRESS_AGE_S = 4.0


class Viewer:
    """Forwards the actions of one viewer to the session and shows refusals.

    Parameters
    ----------
    session : Session
        The session shared by all viewers.
    viewer_id : str
        Name of this viewer in the session.
    user_name : str
        Name of the logged-in user; empty without users.
    now_s : callable
        The clock whose time the page receives as ``server_s``.
    """

    def __init__(
        self,
        session: Session,
        *,
        viewer_id: str,
        user_name: str = "",
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._id, self.words = session, viewer_id, session.words
        self.user_name = user_name
        self._known_stops, self._now_s = session.stops, now_s
        self._pressed_s = math.inf
        self._refreshers: list[tuple[Callable[[], object], ui.element | None]] = []
        #: The shown notification, and whether its reason still holds.
        self._note: tuple[ui.notification, Callable[[], bool]] | None = None

    @property
    def is_driver(self) -> bool:
        """Whether this viewer is the driver."""
        return self._session.driver == self._id

    @property
    def may_act(self) -> bool:
        """Whether this viewer drives, or may because nobody does."""
        return self._session.may_act(self._id)

    @property
    def may_drive(self) -> bool:
        """Whether the role of this viewer may move the hand."""
        return self._session.may_drive(self._id)

    def claim(self) -> bool:
        """Drive if nobody does, and return whether this viewer is the driver."""
        return self._session.claim(self._id)

    def record_press(self, state: object) -> None:
        """Record stop count and server time of the page at a press.

        A press before a STOP may arrive after it, because STOP has a faster route; the stop count
        reveals this. After a network failure, buffered presses arrive late; the time reveals this.
        """
        match state:
            case {"stops": int(stops), "at_s": at_s} if (time_s := finite_number(at_s)) is not None:
                self._known_stops, self._pressed_s = stops, time_s

    def order(self, order: Order) -> bool:
        """Send an order and return whether it was accepted; a refusal is shown."""
        return self._handle_press(
            lambda: self._session.order(self._id, order),
            action=ACTIONS[type(order)],
            is_movement=True,
        )

    def release(self) -> None:
        """Release the object or open the hand."""
        self._handle_press(
            lambda: self._session.release(self._id), action=Action.RELEASE, is_movement=True
        )

    def request(self, request: Request) -> None:
        """Send a request to the running job, as `Session.request`."""
        self._handle_press(
            lambda: self._session.request(self._id, request), action=ACTIONS[type(request)]
        )

    def take_over(self) -> None:
        """Make this viewer the driver."""
        self._session.take_over(self._id)
        self.refresh()

    def run_action(self, action: Action, function: Callable[[], object]) -> bool:
        """Run an action without devices and return whether it succeeded; a refusal is shown."""

        def run_if_allowed() -> None:
            """Run the function if the session allows the action."""
            self._session.check(action, self._id)
            self.claim()
            function()

        return self._handle_press(run_if_allowed, action=action)

    def button(
        self,
        text: str,
        on_click: Callable[[], object],
        *,
        props: str = "",
        small: bool = False,
        action: Action | None = None,
    ) -> ui.button:
        """Add a button, enabled only while its action, if given, is allowed."""
        button = ui.button(text, on_click=on_click, color=None)
        button.classes("btn plain small" if small else "btn plain").props(f"flat no-caps {props}")
        if action is not None:
            self.enable_when_allowed(button, action)
        return button

    def enable_when_allowed(self, button: ui.button | ui.switch, action: Action) -> None:
        """Enable a button while its action is allowed; otherwise its tooltip shows why not."""
        with button:
            # Placed above the button, so that it never covers STOP below.
            hint = ui.tooltip("").props('anchor="top middle" self="bottom middle"')

        def refresh_button() -> None:
            """Enable the button, or show the reason of the refusal."""
            why = self._session.refusal(action, viewer=self._id)
            button.set_enabled(not why)
            hint.set_text(why)
            hint.set_visibility(bool(why))

        self.on_refresh(refresh_button, of=button)

    def enable_for_driver(self, field: DisableableElement) -> None:
        """Enable a field for the driver, or for all if nobody drives; others see its value."""
        self.on_refresh(lambda: field.set_enabled(self.may_act), of=field)

    def show_with_gripper(self, element: ui.element) -> None:
        """Show an element unless the open rig has no gripper."""

        def show() -> None:
            """Show or hide the element."""
            element.set_visibility(not self._session.devices.is_sensor_only)

        self.on_refresh(show, of=element)

    def on_refresh(self, refresher: Callable[[], object], *, of: ui.element | None = None) -> None:
        """Call a function now and at every refresh while its page element exists."""
        self._refreshers.append((refresher, of))
        refresher()

    def on_change(self, value: Callable[[], _Value], show: Callable[[_Value], object]) -> None:
        """Show a value now and whenever it is a different object."""
        shown: list[object] = [object()]

        def show_if_changed() -> None:
            found = value()
            if found is not shown[0]:
                shown[0] = found
                show(found)

        self.on_refresh(show_if_changed)

    def refresh(self) -> None:
        """Update the view of this viewer."""
        self._refreshers = [
            (refresher, of) for refresher, of in self._refreshers if of is None or not of.is_deleted
        ]
        for refresher, _ in self._refreshers:
            refresher()
        if self._note is not None and not self._note[1]():
            self._end_note()

    def _handle_press(
        self, function: Callable[[], None], *, action: Action, is_movement: bool = False
    ) -> bool:
        is_done = False
        self._end_note()
        try:
            # The lock orders the button press strictly before or after a stop.
            with self._session.stop_lock if is_movement else nullcontext():
                if is_movement:
                    self._check_fresh()
                function()
            is_done = True
        except InputError as error:
            self.refuse(error, holds=self._refusal_holds(str(error), action))
        self.refresh()
        return is_done

    def _check_fresh(self) -> None:
        """Refuse a press that precedes a stop or is too old."""
        if self._known_stops < self._session.stops:
            raise InputError(self.words("refusal.stopped"))
        age_s = self._now_s() - self._pressed_s
        if not age_s <= _MAX_PRESS_AGE_S:
            raise InputError(self.words("refusal.late", age=f"{age_s:.0f}"))

    def _refusal_holds(self, why: str, action: Action) -> Callable[[], bool]:
        """Return a function that returns whether a press would be refused for the same reason."""
        session, form = self._session, self._session.form
        if session.refusal(action, viewer=self._id) == why:
            return lambda: session.refusal(action, viewer=self._id) == why
        if form.is_refused:
            return lambda: form.is_refused
        return lambda: True

    def refuse(self, why: Exception | str, *, holds: Callable[[], bool] = lambda: True) -> None:
        """Show the reason of a refusal as a notification, above the fields and buttons."""
        self.show_note(str(why), position="top", holds=holds)

    def show_note(
        self, text: str, *, position: Literal["top", "bottom"], holds: Callable[[], bool]
    ) -> None:
        """Show a notification in place of the last one, for 5 s or while its reason `holds`."""
        self._end_note()
        self._note = ui.notification(text, type="warning", position=position), holds

    def _end_note(self) -> None:
        """Remove the notification before its time is over."""
        if self._note is not None and not self._note[0].is_deleted:
            self._note[0].dismiss()
        self._note = None


def finite_number(value: object) -> float | None:
    """Return a number that a browser sent; None for anything else.

    >>> finite_number(2), finite_number(float("nan")), finite_number(10**400), finite_number("2")
    (2.0, None, None, None)
    """
    try:
        number = float(value) if isinstance(value, int | float) else math.nan
    except OverflowError:
        return None
    return number if math.isfinite(number) else None


def add_heading(text: str) -> ui.html:
    """Add a heading."""
    return ui.html(f"<h3>{html.escape(text)}</h3>", sanitize=False)


def add_paragraph(text: str) -> ui.html:
    """Add a paragraph."""
    return ui.html(f"<p>{html.escape(text)}</p>", sanitize=False)
