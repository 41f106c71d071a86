"""The STOP button in a browser: always reachable, delivered and confirmed."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest
from benchmarks.dashboard import children_of
from playwright.sync_api import Browser, CDPSession, Page, Request, Route, expect
from tests.loop.test_dashboard import (
    SIMULATED,
    TIMEOUT_MS,
    browser,
    drive,
    expect_fresh_link,
    release,
    run_server,
    serve_dashboard,
)

#: Label of the item's field on the page, with a hint if it is empty.
ITEM = re.compile(r"^Item(:|$)")

__all__ = ["browser"]

SIZES = {"phone": (390, 844), "tablet": (834, 1194), "laptop": (1440, 900), "wide": (1920, 1080)}
#: Screen size of tests that do not depend on the size.
ONE_SIZE = pytest.mark.parametrize("viewer", ["laptop"], indirect=True, scope="module")
#: Positions on the button, without its round corners.
INSIDE = [(x, y) for x in (0.03, 0.5, 0.97) for y in (0.12, 0.5, 0.88)]


@dataclass(frozen=True)
class Viewer:
    """A page with a count of its stops."""

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

    def expect_confirmed(self, *, after: int) -> None:
        """Check that a new stop was requested and confirmed."""
        expect(self.page.locator("#stop")).to_have_attribute("data-state", "confirmed")
        expect(self.page.locator("#stop-failed")).to_be_hidden()
        assert len(self.stops) > after

    def touch(self, kind: str, *points: tuple[float, float], radius: float = 5.0) -> None:
        touches = [
            {"x": x, "y": y, "id": number, "radiusX": radius, "radiusY": radius}
            for number, (x, y) in enumerate(points)
        ]
        self.chromium.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})


@contextmanager
def open_viewer(browser: Browser, url: str, size: str) -> Iterator[Viewer]:
    width, height = SIZES[size]
    viewport = {"width": width, "height": height}
    context = browser.new_context(viewport=viewport, has_touch=True, is_mobile=width < 1000)
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    stops: list[Request] = []
    page.on(
        "request", lambda request: stops.append(request) if request.url.endswith("/stop") else None
    )
    page.goto(url)
    expect_fresh_link(page)
    drive(page)
    yield Viewer(page, context.new_cdp_session(page), stops)
    context.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with serve_dashboard(tmp_path_factory.mktemp("stop"), *SIMULATED) as address:
        yield address


@pytest.fixture(scope="module", params=SIZES)
def viewer(request: pytest.FixtureRequest, browser: Browser, address: str) -> Iterator[Viewer]:
    with open_viewer(browser, address, request.param) as viewer:
        yield viewer


@pytest.fixture(autouse=True)
def at_rest(request: pytest.FixtureRequest) -> None:
    """Remove the dialogs, notifications and confirmations of the previous test."""
    if "viewer" in request.fixturenames:
        page = request.getfixturevalue("viewer").page
        while page.locator(".q-dialog__backdrop").count():
            page.keyboard.press("Escape")
            page.wait_for_timeout(50)
        page.evaluate("document.querySelector('#stop').dataset.state = 'idle'")


def test_stop_button_acts_on_press_and_shows_sent_then_confirmed(viewer: Viewer) -> None:
    viewer.expect_on_top()
    seen = "window.seen = []; new MutationObserver(() => window.seen.push(document.querySelector"
    seen += "('#stop').dataset.state)).observe(document.querySelector('#stop'), {attributes: true})"
    viewer.page.evaluate(seen)
    viewer.page.mouse.move(*viewer.middle)
    viewer.page.mouse.down()
    viewer.expect_confirmed(after=0)
    viewer.page.mouse.move(5, 5)
    viewer.page.mouse.up()
    expect(viewer.page.locator("#stop-state")).to_have_text(re.compile(r"confirmed after \d"))
    states = viewer.page.evaluate("window.seen")
    assert states.index("sent") < states.index("confirmed")


def test_stop_button_works_over_an_open_menu_and_selects_nothing(viewer: Viewer) -> None:
    stops, field = len(viewer.stops), viewer.page.get_by_label("Object between the fingers").first
    chosen = field.input_value()
    field.click()
    expect(viewer.page.get_by_role("option", name="tomato")).to_be_attached()
    viewer.expect_on_top()
    menu = viewer.page.locator(".q-select__dialog").bounding_box()
    assert menu["y"] + menu["height"] <= viewer.box["y"]
    viewer.page.touchscreen.tap(*viewer.middle)
    viewer.expect_confirmed(after=stops)
    viewer.page.keyboard.press("Escape")
    assert field.input_value() == chosen


def test_stop_button_is_not_covered_by_a_notification(viewer: Viewer) -> None:
    stops, page = len(viewer.stops), viewer.page
    target = page.get_by_label("Target force, N (empty: a gentle squeeze)")
    target.fill("99")
    page.locator("#grasp").click()
    notification = page.locator(".q-notification").first
    expect(notification).to_contain_text("the target force must be above 0")
    target.fill("")
    viewer.expect_on_top()
    # The final position of the moving notification is checked.
    page.wait_for_function(
        "([end]) => { const toast = document.querySelector('.q-notification');"
        "return !toast || toast.getBoundingClientRect().bottom <= end; }",
        arg=[viewer.box["y"]],
    )
    page.touchscreen.tap(*viewer.middle)
    viewer.expect_confirmed(after=stops)


@ONE_SIZE
def test_stop_button_receives_presses_on_an_element_that_covers_it(viewer: Viewer) -> None:
    stops = len(viewer.stops)
    viewer.page.evaluate(
        "() => { const over = document.createElement('dialog'); over.id = 'over';"
        "over.style.cssText = 'position:fixed;inset:0;width:100vw;height:100vh;max-width:none;"
        "max-height:none'; over.onclick = () => { over.dataset.got = 1 };"
        "document.body.append(over); over.showModal(); }"
    )
    viewer.page.mouse.click(*viewer.middle)
    viewer.expect_confirmed(after=stops)
    assert viewer.page.evaluate("document.querySelector('#over').dataset.got") is None
    viewer.page.evaluate("document.querySelector('#over').remove()")


def test_stop_button_stops_for_a_finger_that_slides_off(viewer: Viewer) -> None:
    stops = len(viewer.stops)
    x, y = viewer.middle
    viewer.touch("touchStart", (x, y))
    viewer.touch("touchMove", (x - 40, y - 200))
    viewer.touch("touchEnd")
    viewer.expect_confirmed(after=stops)


def test_stop_button_stops_for_a_cancelled_palm_touch(viewer: Viewer) -> None:
    stops = len(viewer.stops)
    viewer.touch("touchStart", viewer.middle, radius=80.0)
    viewer.touch("touchCancel")
    viewer.expect_confirmed(after=stops)


def test_stop_button_stops_for_a_second_finger(viewer: Viewer) -> None:
    stops = len(viewer.stops)
    viewer.touch("touchStart", (100.0, 300.0))
    viewer.touch("touchStart", (100.0, 300.0), viewer.middle)
    viewer.touch("touchEnd")
    viewer.expect_confirmed(after=stops)


@ONE_SIZE
@pytest.mark.parametrize("key", ["Escape", "Enter", " "])
def test_stop_button_stops_with_keyboard_keys(viewer: Viewer, key: str) -> None:
    stops = len(viewer.stops)
    if key == "Escape":
        viewer.page.get_by_label(ITEM).focus()
    else:
        viewer.page.locator("#stop").focus()
    viewer.page.keyboard.press(key)
    viewer.expect_confirmed(after=stops)
    assert len(viewer.stops) == stops + 1


@pytest.mark.parametrize("viewer", ["phone", "tablet"], indirect=True, scope="module")
def test_stop_button_stays_visible_during_pinch_zoom(viewer: Viewer) -> None:
    stops, before = len(viewer.stops), viewer.box
    viewer.chromium.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 2.0})
    viewer.page.wait_for_function("visualViewport.scale > 1.9")
    fits = """() => { const box = document.querySelector('#stop').getBoundingClientRect();
        const view = visualViewport, far = (a, b) => Math.abs(a - b);
        return box.left >= view.offsetLeft - 1 && box.right <= view.offsetLeft + view.width + 1
            && box.bottom <= view.offsetTop + view.height + 1
            && far(box.width * view.scale, %f) < 2 }"""
    viewer.page.wait_for_function(fits % before["width"])
    viewer.page.locator("#stop").dispatch_event("click")
    viewer.expect_confirmed(after=stops)
    viewer.chromium.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 1.0})
    viewer.page.wait_for_function("visualViewport.scale < 1.01")


def expect_alarm(viewer: Viewer) -> None:
    """Check that the full-width alarm reports an undelivered stop."""
    alarm = viewer.page.locator("#stop-failed")
    expect(alarm).to_be_visible()
    expect(alarm).to_contain_text("STOP NOT DELIVERED")
    expect(alarm).to_contain_text("use the emergency stop")
    box, size = alarm.bounding_box(), viewer.page.viewport_size
    assert size is not None
    assert box["width"] == pytest.approx(viewer.page.evaluate("document.body.clientWidth"), abs=1)


def expect_greyed(viewer: Viewer, title: str) -> None:
    """Check that all values on the stage are greyed."""
    expect(viewer.page.locator("#lost-title")).to_have_text(title)
    expect(viewer.page.locator("#lost-why")).to_contain_text(re.compile(r"last seen \d+ s ago"))
    expect(viewer.page.locator("#link-text")).to_have_text(re.compile(r"last seen \d+ s ago"))
    expect(viewer.page.locator("#verdict")).to_be_hidden()
    for part in (".figure", ".measures", ".panel-body"):
        expect(viewer.page.locator(part).first).to_have_css("filter", "grayscale(1)")


def test_stop_offline_shows_the_alarm_and_greys_the_page(viewer: Viewer) -> None:
    stops = len(viewer.stops)
    viewer.page.context.set_offline(True)
    expect_greyed(viewer, "No connection")
    viewer.page.touchscreen.tap(*viewer.middle)
    expect_alarm(viewer)
    viewer.expect_on_top()
    viewer.page.context.set_offline(False)
    viewer.expect_confirmed(after=stops)
    expect(viewer.page.locator("#lost")).to_be_hidden()
    expect(viewer.page.locator("#verdict")).to_be_visible()


def expect_stop_delivered(viewer: Viewer) -> None:
    """Check that a press is delivered, even after a reload of the page."""
    expect_fresh_link(viewer.page)
    with viewer.page.expect_response(lambda reply: reply.url.endswith("/stop") and reply.ok):
        viewer.page.touchscreen.tap(*viewer.middle)
    expect(viewer.page.locator("#stop-failed")).to_be_hidden()


def test_stop_with_a_frozen_server_raises_the_alarm_at_the_deadline(
    browser: Browser, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        url, process = stack.enter_context(run_server(tmp_path, *SIMULATED))
        viewers = [stack.enter_context(open_viewer(browser, url, size)) for size in SIZES]
        process.send_signal(signal.SIGSTOP)
        try:
            for viewer in viewers:
                expect_greyed(viewer, "No connection")
                viewer.page.evaluate(_CHECK_ALARM)
                viewer.page.touchscreen.tap(*viewer.middle)
                expect_alarm(viewer)
                viewer.page.wait_for_function("window.after_600_ms !== undefined")
                assert viewer.page.evaluate("[window.after_250_ms, window.after_600_ms]") == [0, 1]
        finally:
            process.send_signal(signal.SIGCONT)
        for viewer in viewers:
            expect_stop_delivered(viewer)


#: Checks the alarm with the page's own timers, whose order does not depend on the load.
_CHECK_ALARM = """() => addEventListener('touchstart', () => {
    const shown = () => document.querySelector('#stop-failed').hidden ? 0 : 1;
    setTimeout(() => { window.after_250_ms = shown() }, 250);
    setTimeout(() => { window.after_600_ms = shown() }, 600);
}, { capture: true, once: true })"""


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


def test_grasp_pressed_before_a_stop_does_not_start_after_the_stop(
    browser: Browser, address: str
) -> None:
    with open_viewer(browser, address, "laptop") as viewer:
        page = viewer.page
        drive(page)
        expect(page.locator("#grasp")).to_be_enabled()
        # Until a request fails, an earlier response may still inform the page about the stop.
        with page.expect_event("requestfailed", lambda request: "/live?" in request.url):
            page.route("**/live?*", lambda route: route.abort())
        page.evaluate(OVERTAKEN)
        expect(page.locator(".q-notification")).to_contain_text("stopped before it started")
        page.unroute("**/live?*")
        expect_fresh_link(page)
        expect(page.locator("#verdict-text")).to_have_text("ready")


def test_page_without_a_socket_reports_it_and_buffers_no_press(
    browser: Browser, address: str
) -> None:
    """Without the socket, a buffered press would move the hand later."""
    with open_viewer(browser, address, "laptop") as viewer:
        page = viewer.page
        drive(page)
        expect(page.locator("#grasp")).to_be_enabled()
        page.evaluate("window.socket.disconnect(); document.getElementById('grasp').click()")
        expect(page.locator("#lost-title")).to_have_text("No connection")
        expect(page.locator("#lost-why")).to_contain_text("Only STOP can be sent")
        expect(page.locator("#lost-why")).not_to_contain_text("values shown are outdated")
        stops = len(viewer.stops)
        page.mouse.click(*viewer.middle)
        viewer.expect_confirmed(after=stops)
        page.evaluate("window.socket.connect()")
        expect(page.locator("#lost")).to_be_hidden()
        expect(page.locator("#verdict-text")).to_have_text("ready")
        drive(page)
        page.locator("#grasp").click()
        expect(page.locator("body")).to_have_attribute("data-activity", "grasping")
        page.mouse.click(*viewer.middle)
        viewer.expect_confirmed(after=stops + 1)
        expect(page.locator("body")).to_have_attribute("data-activity", "watching")
        release(page)


def test_page_press_that_arrives_late_does_not_move_the_hand(
    browser: Browser, address: str
) -> None:
    def late(route: Route) -> None:
        reply = route.fetch()
        document = reply.json()
        route.fulfill(response=reply, json=document | {"server_s": document["server_s"] - 10.0})

    with open_viewer(browser, address, "laptop") as viewer:
        page = viewer.page
        drive(page)
        page.route("**/live?*", late)
        drawn = int(page.locator("body").get_attribute("data-drawn") or 0)
        page.wait_for_function(
            "drawn => Number(document.body.dataset.drawn) > drawn + 1", arg=drawn
        )
        page.locator("#grasp").click()
        expect(page.locator(".q-notification")).to_contain_text("s late: press the button again")
        expect(page.locator("body")).not_to_have_attribute("data-activity", "grasping")
        page.unroute_all(behavior="wait")


def test_page_reports_a_frozen_device_process(browser: Browser, tmp_path: Path) -> None:
    with (
        run_server(tmp_path, *SIMULATED) as (url, process),
        open_viewer(browser, url, "laptop") as viewer,
    ):
        children = children_of(process.pid)
        send_signal(children, signal.SIGSTOP)
        try:
            expect_greyed(viewer, "The devices do not respond")
            expect(viewer.page.locator("#grasp")).to_be_disabled()
            viewer.page.mouse.click(*viewer.middle)
            expect_alarm(viewer)
        finally:
            send_signal(children, signal.SIGCONT)
        viewer.expect_confirmed(after=0)
        expect(viewer.page.locator("#verdict")).to_be_visible()


def send_signal(children: list[int], number: signal.Signals) -> None:
    for child in children:
        os.kill(child, number)
