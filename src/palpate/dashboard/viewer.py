"""One browser's viewer: presses go to the session, refusals are shown; and parts of panels."""

from __future__ import annotations

import html
import math
import time
from collections.abc import Callable
from contextlib import nullcontext
from typing import TypeVar

from nicegui import ui
from nicegui.elements.mixins.disableable_element import DisableableElement

from palpate.dashboard.messages import Action, Order, Request
from palpate.dashboard.session import Session
from palpate.errors import InputError

_Value = TypeVar("_Value")
#: What moves the hand is refused when its press arrives later than this; a slow server may take a
#: second or two.
_MAX_PRESS_AGE_S = 4.0


class Viewer:
    """Passes on the presses of one viewer.

    Parameters
    ----------
    session : Session
        The one that all share.
    viewer_id : str
        Name of this viewer in the session.
    now_s : callable
        The clock shown on the page.
    """

    def __init__(
        self,
        session: Session,
        *,
        viewer_id: str,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._session, self._id = session, viewer_id
        self._known_stops, self._now_s = session.stops, now_s
        self._pressed_s = math.inf
        self._refreshers: list[tuple[Callable[[], object], ui.element | None]] = []

    @property
    def is_driver(self) -> bool:
        """Whether this viewer drives."""
        return self._session.driver == self._id

    def record_press(self, known: object) -> None:
        """Record the page's state at the time of a press.

        How many stops: a press of stop has a faster way than all others, and what was pressed
        before it may come later. When, by the clock of this server: a network that was away
        delivers what it kept.
        """
        match known:
            case {"stops": int(stops), "at_s": int() | float() as at_s}:
                self._known_stops, self._pressed_s = stops, float(at_s)

    def order(self, order: Order) -> bool:
        """Send an order; return whether it was accepted, and show a refusal."""
        return self._run_press(lambda: self._session.order(self._id, order), moves=True)

    def release(self) -> None:
        """Release the object."""
        self._run_press(lambda: self._session.release(self._id), moves=True)

    def request(self, request: Request) -> None:
        """Change the running job, as `Session.request` does."""
        self._run_press(lambda: self._session.request(self._id, request))

    def take_over(self) -> None:
        """Drive from now on."""
        self._session.take_over(self._id)
        self.refresh()

    def run_action(self, action: Action, act: Callable[[], object]) -> bool:
        """Run an action without devices; return its success, and show a refusal."""

        def act_if_allowed() -> None:
            """Do it, unless this viewer may not now."""
            why = self._session.refusal(action, viewer=self._id)
            if why:
                raise InputError(why)
            act()

        return self._run_press(act_if_allowed)

    def button(
        self,
        text: str,
        act: Callable[[], object],
        *,
        props: str = "",
        small: bool = False,
        action: Action | None = None,
    ) -> ui.button:
        """Add a button; with an action it is enabled only while that may be pressed."""
        button = ui.button(text, on_click=act, color=None)
        button.classes("btn plain small" if small else "btn plain").props(f"flat no-caps {props}")
        if action is not None:
            self.enable_when_allowed(button, action)
        return button

    def enable_when_allowed(self, button: ui.button | ui.switch, action: Action) -> None:
        """Enable a button only while it may be pressed; else its tooltip shows the reason."""
        with button:
            # Above: what is below may be the stop button.
            hint = ui.tooltip("").props('anchor="top middle" self="bottom middle"')

        def refresh_button() -> None:
            """Enable the button, or give the reason why not."""
            why = self._session.refusal(action, viewer=self._id)
            button.set_enabled(not why)
            hint.set_text(why)
            hint.set_visibility(bool(why))

        self.on_refresh(refresh_button, of=button)

    def enable_for_driver(self, field: DisableableElement) -> None:
        """Enable a field of the next grasp for the driver alone; others see its value."""
        self.on_refresh(lambda: field.set_enabled(self.is_driver), of=field)

    def show_with_gripper(self, element: ui.element) -> None:
        """Show an element only while the rig has a gripper, or none is open yet."""

        def show() -> None:
            """Show the element with a gripper, hide it without one."""
            element.set_visibility(not self._session.devices.is_sensor_only)

        self.on_refresh(show, of=element)

    def on_refresh(self, refresher: Callable[[], object], *, of: ui.element | None = None) -> None:
        """Call a function now and periodically while its page element exists."""
        self._refreshers.append((refresher, of))
        refresher()

    def on_change(self, value: Callable[[], _Value], show: Callable[[_Value], object]) -> None:
        """Show a value now, and again whenever it is another one."""
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

    def _run_press(self, press: Callable[[], None], *, moves: bool = False) -> bool:
        is_done = False
        try:
            # A stop is before it, or after it.
            with self._session.stop_lock if moves else nullcontext():
                if moves:
                    self._check_fresh()
                press()
            is_done = True
        except InputError as error:
            self.refuse(error)
        self.refresh()
        return is_done

    def _check_fresh(self) -> None:
        """Refuse a press from before a stop, or one that is too old."""
        if self._known_stops < self._session.stops:
            raise InputError("stopped before it started")
        age_s = self._now_s() - self._pressed_s
        if age_s > _MAX_PRESS_AGE_S:
            raise InputError(f"the press came {age_s:.0f} s late: press again")

    def refuse(self, error: Exception) -> None:
        """Show the reason of a refusal."""
        ui.notify(str(error), type="warning")


def add_heading(text: str) -> ui.html:
    """Add a heading."""
    return ui.html(f"<h3>{html.escape(text)}</h3>", sanitize=False)


def add_paragraph(text: str) -> ui.html:
    """Add a paragraph."""
    return ui.html(f"<p>{html.escape(text)}</p>", sanitize=False)
