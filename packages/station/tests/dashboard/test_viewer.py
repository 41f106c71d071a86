"""A viewer: refreshes, deleted elements, late presses and concurrent stops."""

from __future__ import annotations

import math
from threading import Thread
from types import SimpleNamespace

import pytest
from nicegui import ui

from palpate_station.dashboard.messages import (
    Examine,
    OpenRig,
    Order,
    Request,
    SetSpeed,
    StopNow,
)
from palpate_station.dashboard.session import Session
from palpate_station.dashboard.viewer import Viewer, finite_number


def record_notifications(monkeypatch: pytest.MonkeyPatch, shown: list[str]) -> list[str]:
    """Record the notifications in `shown`; return the list of those that are visible."""
    visible: list[str] = []

    def notify(text: str, **options: object) -> SimpleNamespace:
        shown.append(text)
        visible.append(text)
        return SimpleNamespace(is_deleted=False, dismiss=lambda: visible.remove(text))

    monkeypatch.setattr(ui, "notification", notify)
    return visible


def test_refusal_is_shown_only_while_its_reason_holds(monkeypatch: pytest.MonkeyPatch) -> None:
    visible = record_notifications(monkeypatch, [])
    session = Session(send=lambda message: None)
    session.join("a")
    session.claim("a")
    session.join("b", name="the page at 10.0.0.7")
    viewer = Viewer(session, viewer_id="b")
    viewer.request(SetSpeed(2.0))
    viewer.refresh()
    assert visible == ["a page drives; take over first"]
    session.leave("a")
    viewer.refresh()
    assert visible == []
    viewer.refuse("an event without a state")
    viewer.take_over()
    assert visible == ["an event without a state"]
    viewer.request(SetSpeed(2.0))
    assert visible == []


def test_viewer_refuses_a_late_press_that_would_move_the_hand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """After a network failure, buffered presses arrive when a movement is unexpected."""
    sent: list[object] = []
    refused: list[str] = []
    record_notifications(monkeypatch, refused)
    now_s = [100.0]
    session = Session(send=sent.append)
    session.join("a")
    viewer = Viewer(session, viewer_id="a", now_s=lambda: now_s[0])
    for at_s, reason in (
        (100.0, ""),
        (96.5, ""),
        (88.0, "the button press arrived 12 s late: press the button again"),
    ):
        viewer.record_press({"stops": session.stops, "at_s": at_s})
        viewer.order(Examine())
        assert ("late" in reason) == any("late" in one for one in refused), refused
    assert refused[-1] == "the button press arrived 12 s late: press the button again"
    viewer.record_press({"stops": session.stops, "at_s": 101.0})
    now_s[0] = 130.0
    viewer.release()
    assert refused[-1] == "the button press arrived 29 s late: press the button again"


def test_viewer_order_and_its_check_exclude_a_concurrent_stop() -> None:
    """A stop from another thread must prevent an order that has passed its check."""
    sent: list[object] = []
    stops: list[Thread] = []

    def send(message: Order | Request) -> None:
        if isinstance(message, OpenRig):
            stops.append(Thread(target=session.stop))
            stops[0].start()
            stops[0].join(timeout=0.05)
        sent.append(message)

    session = Session(send=send)
    session.join("a")
    viewer = Viewer(session, viewer_id="a", now_s=lambda: 0.0)
    viewer.record_press({"stops": 0, "at_s": 0.0})
    viewer.order(OpenRig(name="sim-rigid"))
    stops[0].join()
    assert sent == [OpenRig(name="sim-rigid"), StopNow(1)]


@pytest.mark.parametrize("value", [math.nan, math.inf, 10**400, "2", [1.0], {"a": 1}, None])
def test_value_of_a_browser_that_is_not_a_finite_number_is_dropped(
    value: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert finite_number(value) is None
    # A press without a usable time retains the last one, which is late here.
    refused: list[str] = []
    record_notifications(monkeypatch, refused)
    viewer = Viewer(Session(send=print), viewer_id="a", now_s=lambda: 100.0)
    viewer.record_press({"stops": 0, "at_s": 50.0})
    viewer.record_press({"stops": 0, "at_s": value})
    viewer.order(Examine())
    assert refused == ["the button press arrived 50 s late: press the button again"]
