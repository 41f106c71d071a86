"""The STOP button in a browser: always reachable, delivered and confirmed."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from benchmarks.processes import children_of
from packages.station.tests.served_pages import (
    ITEM,
    PHONE,
    SIMULATED,
    TARGET,
    drive,
    expect_enabled,
    expect_fresh_link,
    expect_verdict,
    run_server,
    visit_as_driver,
    wait_for_draws,
)
from playwright.sync_api import Browser, CDPSession, Page, Request, Route, ViewportSize, expect

LAPTOP: ViewportSize = {"width": 1440, "height": 900}
SIZES = {"phone": PHONE, "laptop": LAPTOP}
OTHER_SIZES: tuple[ViewportSize, ...] = (
    {"width": 834, "height": 1194},
    {"width": 1920, "height": 1080},
)
ON_LAPTOP = pytest.mark.parametrize("viewer", ["laptop"], indirect=True, scope="module")
ON_PHONE = pytest.mark.parametrize("viewer", ["phone"], indirect=True, scope="module")
#: Positions on the button, without its round corners.
INSIDE = [(x, y) for x in (0.03, 0.5, 0.97) for y in (0.12, 0.5, 0.88)]
#: Keeps every state that the button shows, as it shows a confirmation for a limited time.
KEEP_STATES = """() => {
    const [stop, words] = ['stop', 'stop-state'].map((id) => document.getElementById(id));
    window.states = [];
    new MutationObserver(() => {
        window.states.push(stop.dataset.state);
        window.words = words.textContent;
    }).observe(stop, { attributes: true, attributeFilter: ['data-state'] });
}"""


@dataclass(frozen=True)
class Viewer:
    """A page with a record of its stops."""

    page: Page
    chromium: CDPSession
    stops: list[Request]

    @property
    def box(self) -> dict[str, float]:
        box = self.page.locator("#stop").bounding_box()
        assert box is not None
        return dict(box)

    @property
    def middle(self) -> tuple[float, float]:
        box = self.box
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def expect_on_top(self) -> None:
        """Check that the button is visible and not covered."""
        box, size = self.box, self.page.viewport_size
        assert min(box["width"], box["height"]) >= 80
        assert box["x"] >= 0 <= box["y"]
        assert box["x"] + box["width"] <= size["width"]
        assert box["y"] + box["height"] <= size["height"]
        for x, y in INSIDE:
            at = [box["x"] + x * box["width"], box["y"] + y * box["height"]]
            hit = "([x, y]) => document.elementFromPoint(x, y).closest('#stop') !== null"
            assert self.page.evaluate(hit, at), f"STOP is covered at {x}, {y}"

    @contextmanager
    def expect_stopped(self) -> Iterator[None]:
        """Check that what follows requests a stop, which is shown as confirmed."""
        self.page.evaluate("window.states = []")
        before = len(self.stops)
        yield
        self.page.wait_for_function("window.states.includes('confirmed')")
        expect(self.page.locator("#stop-failed")).to_be_hidden()
        assert len(self.stops) > before

    def touch(self, kind: str, *points: tuple[float, float], radius: float = 5.0) -> None:
        touches = [
            {"x": x, "y": y, "id": number, "radiusX": radius, "radiusY": radius}
            for number, (x, y) in enumerate(points)
        ]
        self.chromium.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})


@contextmanager
def open_viewer(browser: Browser, url: str, size: str) -> Iterator[Viewer]:
    options = {"viewport": SIZES[size], "has_touch": True, "is_mobile": size == "phone"}
    with visit_as_driver(browser, url, **options) as page:
        stops: list[Request] = []
        page.on(
            "request",
            lambda request: stops.append(request) if request.url.endswith("/stop") else None,
        )
        page.evaluate(KEEP_STATES)
        # The page reloads itself after a long loss.
        page.add_init_script(f"addEventListener('DOMContentLoaded', {KEEP_STATES})")
        yield Viewer(page, page.context.new_cdp_session(page), stops)


@pytest.fixture(scope="module", params=SIZES)
def viewer(request: pytest.FixtureRequest, browser: Browser, address: str) -> Iterator[Viewer]:
    with open_viewer(browser, address, request.param) as viewer:
        yield viewer


def test_stop_button_acts_on_press(viewer: Viewer) -> None:
    viewer.expect_on_top()
    with viewer.expect_stopped():
        viewer.page.mouse.move(*viewer.middle)
        viewer.page.mouse.down()
        viewer.page.wait_for_function("window.states.includes('confirmed')")
        assert re.search(r"confirmed after \d", viewer.page.evaluate("window.words"))
        states = viewer.page.evaluate("window.states")
        assert states.index("sent") < states.index("confirmed")
        viewer.page.mouse.move(5, 5)
        viewer.page.mouse.up()


@ON_LAPTOP
def test_stop_button_is_on_top_at_every_size(viewer: Viewer) -> None:
    for size in OTHER_SIZES:
        viewer.page.set_viewport_size(size)
        viewer.page.wait_for_function("(width) => innerWidth === width", arg=size["width"])
        viewer.expect_on_top()
    viewer.page.set_viewport_size(LAPTOP)


def test_stop_button_works_over_an_open_menu_and_selects_nothing(viewer: Viewer) -> None:
    field = viewer.page.get_by_label("Object between the fingers").first
    chosen = field.input_value()
    field.click()
    expect(viewer.page.get_by_role("option", name="tomato")).to_be_attached()
    viewer.expect_on_top()
    menu = viewer.page.locator(".q-select__dialog").bounding_box()
    assert menu["y"] + menu["height"] <= viewer.box["y"]
    with viewer.expect_stopped():
        viewer.page.touchscreen.tap(*viewer.middle)
    with viewer.expect_stopped():
        viewer.page.keyboard.press("Escape")
    expect(viewer.page.locator(".q-dialog__backdrop")).to_have_count(0)
    assert field.input_value() == chosen


def test_stop_button_is_not_covered_by_a_notification(viewer: Viewer) -> None:
    page = viewer.page
    page.get_by_label(TARGET).fill("99")
    page.locator("#grasp").click()
    notification = page.locator(".q-notification").first
    expect(notification).to_contain_text("must be at least 0.15 N")
    page.get_by_label(TARGET).fill("")
    viewer.expect_on_top()
    # The final position of the moving notification is checked.
    page.wait_for_function(
        "([end]) => { const toast = document.querySelector('.q-notification');"
        "return !toast || toast.getBoundingClientRect().bottom <= end; }",
        arg=[viewer.box["y"]],
    )
    with viewer.expect_stopped():
        page.touchscreen.tap(*viewer.middle)


@ON_LAPTOP
def test_stop_button_receives_presses_on_an_element_that_covers_it(viewer: Viewer) -> None:
    viewer.page.evaluate(
        "() => { const over = document.createElement('dialog'); over.id = 'over';"
        "over.style.cssText = 'position:fixed;inset:0;width:100vw;height:100vh;max-width:none;"
        "max-height:none'; over.onclick = () => { over.dataset.got = 1 };"
        "document.body.append(over); over.showModal(); }"
    )
    with viewer.expect_stopped():
        viewer.page.mouse.click(*viewer.middle)
    assert viewer.page.evaluate("document.querySelector('#over').dataset.got") is None
    viewer.page.evaluate("document.querySelector('#over').remove()")


def slide_off(viewer: Viewer) -> None:
    x, y = viewer.middle
    viewer.touch("touchStart", (x, y))
    viewer.touch("touchMove", (x - 40, y - 200))
    viewer.touch("touchEnd")


def rest_a_palm(viewer: Viewer) -> None:
    viewer.touch("touchStart", viewer.middle, radius=80.0)
    viewer.touch("touchCancel")


def add_a_finger(viewer: Viewer) -> None:
    viewer.touch("touchStart", (100.0, 300.0))
    viewer.touch("touchStart", (100.0, 300.0), viewer.middle)
    viewer.touch("touchEnd")


@ON_PHONE
@pytest.mark.parametrize("touch", [slide_off, rest_a_palm, add_a_finger])
def test_stop_button_stops_for_any_touch(viewer: Viewer, touch: Callable[[Viewer], None]) -> None:
    with viewer.expect_stopped():
        touch(viewer)


@ON_LAPTOP
@pytest.mark.parametrize(("key", "focus"), [("Escape", "item"), ("Enter", "stop"), (" ", "stop")])
def test_stop_button_stops_with_keyboard_keys(viewer: Viewer, key: str, focus: str) -> None:
    page = viewer.page
    (page.get_by_label(ITEM) if focus == "item" else page.locator("#stop")).focus()
    with viewer.expect_stopped():
        page.keyboard.press(key)


@ON_PHONE
def test_stop_button_stays_visible_during_pinch_zoom(viewer: Viewer) -> None:
    before = viewer.box
    viewer.chromium.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 2.0})
    viewer.page.wait_for_function("visualViewport.scale > 1.9")
    fits = """() => { const box = document.querySelector('#stop').getBoundingClientRect();
        const view = visualViewport, far = (a, b) => Math.abs(a - b);
        return box.left >= view.offsetLeft - 1 && box.right <= view.offsetLeft + view.width + 1
            && box.bottom <= view.offsetTop + view.height + 1
            && far(box.width * view.scale, %f) < 2 }"""
    viewer.page.wait_for_function(fits % before["width"])
    with viewer.expect_stopped():
        viewer.page.locator("#stop").dispatch_event("click")
    viewer.chromium.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 1.0})
    viewer.page.wait_for_function("visualViewport.scale < 1.01")


def expect_alarm(viewer: Viewer) -> None:
    """Check that the full-width alarm reports an undelivered stop."""
    alarm = viewer.page.locator("#stop-failed")
    expect(alarm).to_be_visible()
    expect(alarm).to_contain_text("STOP NOT DELIVERED")
    expect(alarm).to_contain_text("use the emergency stop")
    width = alarm.bounding_box()["width"]
    assert width == pytest.approx(viewer.page.evaluate("document.body.clientWidth"), abs=1)


def expect_greyed(viewer: Viewer, title: str) -> None:
    """Check that all values on the stage are greyed."""
    expect(viewer.page.locator("#lost-title")).to_have_text(title)
    expect(viewer.page.locator("#lost-why")).to_contain_text(re.compile(r"last seen \d+ s ago"))
    expect(viewer.page.locator("#link-text")).to_have_text(re.compile(r"last seen \d+ s ago"))
    expect(viewer.page.locator("#verdict")).to_be_hidden()
    for part in (".figure", ".measures", ".panel-body"):
        expect(viewer.page.locator(part).first).to_have_css("filter", "grayscale(1)")


def test_stop_offline_shows_the_alarm_and_greys_the_page(viewer: Viewer) -> None:
    with viewer.expect_stopped():
        viewer.page.context.set_offline(True)
        expect_greyed(viewer, "No connection")
        viewer.page.touchscreen.tap(*viewer.middle)
        expect_alarm(viewer)
        viewer.expect_on_top()
        viewer.page.context.set_offline(False)
    expect(viewer.page.locator("#lost")).to_be_hidden()
    expect(viewer.page.locator("#verdict")).to_be_visible()


#: Checks the alarm with the page's own timers, whose order does not depend on the load.
CHECK_ALARM = """() => addEventListener('touchstart', () => {
    const shown = () => document.querySelector('#stop-failed').hidden ? 0 : 1;
    setTimeout(() => { window.after_250_ms = shown() }, 250);
    setTimeout(() => { window.after_600_ms = shown() }, 600);
}, { capture: true, once: true })"""


def test_stop_with_frozen_devices_or_server_raises_the_alarm_at_the_deadline(
    browser: Browser, tmp_path: Path
) -> None:
    with (
        run_server(tmp_path, *SIMULATED) as (url, server),
        open_viewer(browser, url, "laptop") as viewer,
    ):
        page = viewer.page
        devices = children_of(server.pid)
        send_signal(devices, signal.SIGSTOP)
        try:
            expect_greyed(viewer, "The devices do not respond")
            expect(page.locator("#grasp")).to_be_disabled()
            page.touchscreen.tap(*viewer.middle)
            expect_alarm(viewer)
        finally:
            send_signal(devices, signal.SIGCONT)
        expect_stop_delivered(viewer)
        # A stop that was given up is an alarm until the devices are ready again, and is listed.
        page.evaluate("sessionStorage.setItem('palpate-stop', Date.now() - 60000)")
        page.reload()
        expect(page.locator("#stop")).to_have_attribute("data-state", "idle")
        expect(page.locator("#stop-failed")).to_be_hidden()
        assert page.evaluate("sessionStorage.getItem('palpate-stop')") is None
        page.wait_for_function(
            "async () => (await (await fetch('/live')).json()).alarms"
            ".some(([, text]) => text === 'STOP NOT DELIVERED')"
        )
        # A page that reloaded itself repeats its stop, whose deadline would raise the alarm early.
        page.wait_for_timeout(1000)
        expect(page.locator("#stop-failed")).to_be_hidden()
        send_signal([server.pid], signal.SIGSTOP)
        try:
            expect_greyed(viewer, "No connection")
            page.evaluate(CHECK_ALARM)
            page.touchscreen.tap(*viewer.middle)
            expect_alarm(viewer)
            page.wait_for_function("window.after_600_ms !== undefined")
            assert page.evaluate("[window.after_250_ms, window.after_600_ms]") == [0, 1]
        finally:
            send_signal([server.pid], signal.SIGCONT)
        expect_stop_delivered(viewer)


def expect_stop_delivered(viewer: Viewer) -> None:
    """Check that a press is delivered again, even if the page has reloaded itself."""
    expect_fresh_link(viewer.page)
    with viewer.page.expect_response(lambda reply: reply.url.endswith("/stop") and reply.ok):
        viewer.page.touchscreen.tap(*viewer.middle)
    expect(viewer.page.locator("#stop-failed")).to_be_hidden()


def send_signal(processes: list[int], number: signal.Signals) -> None:
    for process in processes:
        os.kill(process, number)


#: Makes each request of a stop fail in this document.
WITHOUT_STOP = """() => {
    const fetch = window.fetch;
    window.fetch = (url, ...rest) => url === "/stop" ? Promise.reject() : fetch(url, ...rest);
}"""


def test_reloaded_page_repeats_an_undelivered_stop(browser: Browser, address: str) -> None:
    with open_viewer(browser, address, "laptop") as viewer:
        page = viewer.page
        # The page's clock is stopped, so the loading time does not matter.
        page.add_init_script("Date.now = () => 1e12")
        page.evaluate("Date.now = () => 1e12")
        # Until it is reloaded: the page itself repeats the stop every quarter of a second.
        page.evaluate(WITHOUT_STOP)
        page.touchscreen.tap(*viewer.middle)
        expect_alarm(viewer)
        with page.expect_response(lambda reply: reply.url.endswith("/stop") and reply.ok):
            page.reload()
        page.wait_for_function("sessionStorage.getItem('palpate-stop') === null")
        stops = len(viewer.stops)
        page.reload()
        expect_fresh_link(page)
        assert len(viewer.stops) == stops


#: Sends a stop, then a press of Grasp from a page that does not know the stop yet.
OVERTAKEN = """async () => {
    await fetch('/stop', { method: 'POST' });
    document.getElementById('grasp').click();
}"""


@ON_LAPTOP
def test_grasp_pressed_before_a_stop_does_not_start_after_the_stop(viewer: Viewer) -> None:
    page = viewer.page
    expect_enabled(page, "#grasp")
    # Until a request fails, an earlier response may still inform the page about the stop.
    with page.expect_event("requestfailed", lambda request: "/live?" in request.url):
        page.route("**/live?*", lambda route: route.abort())
    page.evaluate(OVERTAKEN)
    refused = page.locator(".q-notification", has_text="stopped before it started")
    expect(refused).to_be_visible()
    page.unroute("**/live?*")
    expect_fresh_link(page)
    expect_verdict(page, "ready")


def test_page_without_a_socket_reports_it_and_buffers_no_press(
    browser: Browser, address: str
) -> None:
    """Without the socket, a buffered press would move the hand later.

    Connected again, the page may reload itself, so it is not used for more.
    """
    with open_viewer(browser, address, "laptop") as viewer:
        page = viewer.page
        expect_enabled(page, "#grasp")
        page.evaluate("window.socket.disconnect(); document.getElementById('grasp').click()")
        expect(page.locator("#lost-title")).to_have_text("No connection")
        expect(page.locator("#lost-why")).to_contain_text("Only STOP can be sent")
        expect(page.locator("#lost-why")).not_to_contain_text("values shown are outdated")
        with viewer.expect_stopped():
            page.mouse.click(*viewer.middle)
        page.evaluate("window.socket.connect()")
        expect(page.locator("#lost")).to_be_hidden()
        expect_fresh_link(page)
        expect_verdict(page, "ready")


@ON_LAPTOP
def test_page_press_that_arrives_late_does_not_move_the_hand(viewer: Viewer) -> None:
    def late(route: Route) -> None:
        reply = route.fetch()
        document = reply.json()
        route.fulfill(response=reply, json=document | {"server_s": document["server_s"] - 10.0})

    page = viewer.page
    drive(page)
    expect_enabled(page, "#grasp")
    page.route("**/live?*", late)
    wait_for_draws(page, 2)
    page.locator("#grasp").click()
    refused = page.locator(".q-notification", has_text="s late: press the button again")
    expect(refused).to_be_visible()
    expect(page.locator("body")).not_to_have_attribute("data-activity", "grasping")
    page.unroute_all(behavior="wait")
