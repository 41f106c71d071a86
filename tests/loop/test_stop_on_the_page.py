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
    fresh,
    release,
    served,
    serving,
)

__all__ = ["browser"]

SIZES = {"phone": (390, 844), "tablet": (834, 1194), "laptop": (1440, 900), "wide": (1920, 1080)}
#: Screen size of tests that do not depend on the size.
ONE_SIZE = pytest.mark.parametrize("one", ["laptop"], indirect=True, scope="module")
#: Positions on the button, without its round corners.
INSIDE = [(x, y) for x in (0.03, 0.5, 0.97) for y in (0.12, 0.5, 0.88)]


@dataclass(frozen=True)
class Viewer:
    """A page with a count of its stops."""

    page: Page
    chromium: CDPSession
    asked: list[Request]

    @property
    def box(self) -> dict[str, float]:
        box = self.page.locator("#stop").bounding_box()
        assert box is not None
        return dict(box)

    @property
    def middle(self) -> tuple[float, float]:
        box = self.box
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def on_top(self) -> None:
        """Check that the button is visible and not covered."""
        box, size = self.box, self.page.viewport_size
        assert min(box["width"], box["height"]) >= 80
        assert box["x"] >= 0 <= box["y"]
        assert box["x"] + box["width"] <= size["width"]
        assert box["y"] + box["height"] <= size["height"]
        for x, y in INSIDE:
            at = [box["x"] + x * box["width"], box["y"] + y * box["height"]]
            hit = "([x, y]) => document.elementFromPoint(x, y).closest('#stop') !== null"
            assert self.page.evaluate(hit, at), f"something covers STOP at {x}, {y}"

    def confirmed(self, *, after: int) -> None:
        """Check that a new stop was requested and confirmed."""
        expect(self.page.locator("#stop")).to_have_attribute("data-state", "confirmed")
        expect(self.page.locator("#stop-failed")).to_be_hidden()
        assert len(self.asked) > after

    def touch(self, kind: str, *points: tuple[float, float], radius: float = 5.0) -> None:
        touches = [
            {"x": x, "y": y, "id": number, "radiusX": radius, "radiusY": radius}
            for number, (x, y) in enumerate(points)
        ]
        self.chromium.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touches})


@contextmanager
def viewer(browser: Browser, url: str, size: str) -> Iterator[Viewer]:
    width, height = SIZES[size]
    viewport = {"width": width, "height": height}
    context = browser.new_context(viewport=viewport, has_touch=True, is_mobile=width < 1000)
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    asked: list[Request] = []
    page.on("request", lambda one: asked.append(one) if one.url.endswith("/stop") else None)
    page.goto(url)
    fresh(page)
    drive(page)
    yield Viewer(page, context.new_cdp_session(page), asked)
    context.close()


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("stop"), *SIMULATED) as address:
        yield address


@pytest.fixture(scope="module", params=SIZES)
def one(request: pytest.FixtureRequest, browser: Browser, address: str) -> Iterator[Viewer]:
    with viewer(browser, address, request.param) as one:
        yield one


@pytest.fixture(autouse=True)
def at_rest(request: pytest.FixtureRequest) -> None:
    """Remove the dialogs, notifications and confirmations of the previous test."""
    if "one" in request.fixturenames:
        page = request.getfixturevalue("one").page
        while page.locator(".q-dialog__backdrop").count():
            page.keyboard.press("Escape")
            page.wait_for_timeout(50)
        page.evaluate("document.querySelector('#stop').dataset.state = 'idle'")


def test_stop_button_acts_on_press_and_shows_sent_then_confirmed(one: Viewer) -> None:
    one.on_top()
    seen = "window.seen = []; new MutationObserver(() => window.seen.push(document.querySelector"
    seen += "('#stop').dataset.state)).observe(document.querySelector('#stop'), {attributes: true})"
    one.page.evaluate(seen)
    one.page.mouse.move(*one.middle)
    one.page.mouse.down()
    one.confirmed(after=0)
    one.page.mouse.move(5, 5)
    one.page.mouse.up()
    expect(one.page.locator("#stop-state")).to_have_text(re.compile(r"confirmed after \d"))
    states = one.page.evaluate("window.seen")
    assert states.index("sent") < states.index("confirmed")


def test_stop_button_works_over_an_open_menu_and_selects_nothing(one: Viewer) -> None:
    asked, field = len(one.asked), one.page.get_by_label("Object between the fingers").first
    chosen = field.input_value()
    field.click()
    expect(one.page.get_by_role("option", name="tomato")).to_be_attached()
    one.on_top()
    menu = one.page.locator(".q-select__dialog").bounding_box()
    assert menu["y"] + menu["height"] <= one.box["y"]
    one.page.touchscreen.tap(*one.middle)
    one.confirmed(after=asked)
    one.page.keyboard.press("Escape")
    assert field.input_value() == chosen


def test_stop_button_is_not_covered_by_a_notification(one: Viewer) -> None:
    asked, page = len(one.asked), one.page
    wish = page.get_by_label("Target force, N (empty: a gentle squeeze)")
    wish.fill("99")
    page.locator("#grasp").click()
    toast = page.locator(".q-notification").first
    expect(toast).to_contain_text("the target force must be above 0")
    wish.fill("")
    one.on_top()
    # The final position of the moving notification is checked.
    page.wait_for_function(
        "([end]) => { const toast = document.querySelector('.q-notification');"
        "return !toast || toast.getBoundingClientRect().bottom <= end; }",
        arg=[one.box["y"]],
    )
    page.touchscreen.tap(*one.middle)
    one.confirmed(after=asked)


@ONE_SIZE
def test_stop_button_receives_presses_on_an_element_that_covers_it(one: Viewer) -> None:
    asked = len(one.asked)
    one.page.evaluate(
        "() => { const over = document.createElement('dialog'); over.id = 'over';"
        "over.style.cssText = 'position:fixed;inset:0;width:100vw;height:100vh;max-width:none;"
        "max-height:none'; over.onclick = () => { over.dataset.got = 1 };"
        "document.body.append(over); over.showModal(); }"
    )
    one.page.mouse.click(*one.middle)
    one.confirmed(after=asked)
    assert one.page.evaluate("document.querySelector('#over').dataset.got") is None
    one.page.evaluate("document.querySelector('#over').remove()")


def test_stop_button_stops_for_a_finger_that_slides_off(one: Viewer) -> None:
    asked = len(one.asked)
    x, y = one.middle
    one.touch("touchStart", (x, y))
    one.touch("touchMove", (x - 40, y - 200))
    one.touch("touchEnd")
    one.confirmed(after=asked)


def test_stop_button_stops_for_a_cancelled_palm_touch(one: Viewer) -> None:
    asked = len(one.asked)
    one.touch("touchStart", one.middle, radius=80.0)
    one.touch("touchCancel")
    one.confirmed(after=asked)


def test_stop_button_stops_for_a_second_finger(one: Viewer) -> None:
    asked = len(one.asked)
    one.touch("touchStart", (100.0, 300.0))
    one.touch("touchStart", (100.0, 300.0), one.middle)
    one.touch("touchEnd")
    one.confirmed(after=asked)


@ONE_SIZE
@pytest.mark.parametrize("key", ["Escape", "Enter", " "])
def test_stop_button_stops_with_keyboard_keys(one: Viewer, key: str) -> None:
    asked = len(one.asked)
    if key == "Escape":
        one.page.get_by_label("Item (empty: not stored)").focus()
    else:
        one.page.locator("#stop").focus()
    one.page.keyboard.press(key)
    one.confirmed(after=asked)
    assert len(one.asked) == asked + 1


@pytest.mark.parametrize("one", ["phone", "tablet"], indirect=True, scope="module")
def test_stop_button_stays_visible_during_pinch_zoom(one: Viewer) -> None:
    asked, before = len(one.asked), one.box
    one.chromium.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 2.0})
    one.page.wait_for_function("visualViewport.scale > 1.9")
    fits = """() => { const box = document.querySelector('#stop').getBoundingClientRect();
        const view = visualViewport, far = (a, b) => Math.abs(a - b);
        return box.left >= view.offsetLeft - 1 && box.right <= view.offsetLeft + view.width + 1
            && box.bottom <= view.offsetTop + view.height + 1
            && far(box.width * view.scale, %f) < 2 }"""
    one.page.wait_for_function(fits % before["width"])
    one.page.locator("#stop").dispatch_event("click")
    one.confirmed(after=asked)
    one.chromium.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 1.0})
    one.page.wait_for_function("visualViewport.scale < 1.01")


def alarmed(one: Viewer) -> None:
    """Check that the full-width alarm reports an undelivered stop."""
    alarm = one.page.locator("#stop-failed")
    expect(alarm).to_be_visible()
    expect(alarm).to_contain_text("STOP NOT DELIVERED")
    expect(alarm).to_contain_text("use the emergency stop")
    box, size = alarm.bounding_box(), one.page.viewport_size
    assert size is not None
    assert box["width"] == pytest.approx(one.page.evaluate("document.body.clientWidth"), abs=1)


def greyed(one: Viewer, title: str) -> None:
    """Check that all values on the stage are greyed."""
    expect(one.page.locator("#lost-title")).to_have_text(title)
    expect(one.page.locator("#lost-why")).to_contain_text(re.compile(r"last seen \d+ s ago"))
    expect(one.page.locator("#link-text")).to_have_text(re.compile(r"last seen \d+ s ago"))
    expect(one.page.locator("#verdict")).to_be_hidden()
    for part in (".figure", ".measures", ".panel-body"):
        expect(one.page.locator(part).first).to_have_css("filter", "grayscale(1)")


def test_stop_offline_shows_the_alarm_and_greys_the_page(one: Viewer) -> None:
    asked = len(one.asked)
    one.page.context.set_offline(True)
    greyed(one, "No connection")
    one.page.touchscreen.tap(*one.middle)
    alarmed(one)
    one.on_top()
    one.page.context.set_offline(False)
    one.confirmed(after=asked)
    expect(one.page.locator("#lost")).to_be_hidden()
    expect(one.page.locator("#verdict")).to_be_visible()


def works_again(one: Viewer) -> None:
    """Check that a press is delivered, even after a reload of the page."""
    fresh(one.page)
    with one.page.expect_response(lambda reply: reply.url.endswith("/stop") and reply.ok):
        one.page.touchscreen.tap(*one.middle)
    expect(one.page.locator("#stop-failed")).to_be_hidden()


def test_stop_with_a_frozen_server_raises_the_alarm_at_the_deadline(
    browser: Browser, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        url, process = stack.enter_context(serving(tmp_path, *SIMULATED))
        viewers = [stack.enter_context(viewer(browser, url, size)) for size in SIZES]
        process.send_signal(signal.SIGSTOP)
        try:
            for one in viewers:
                greyed(one, "No connection")
                one.page.evaluate(_LOOKS)
                one.page.touchscreen.tap(*one.middle)
                alarmed(one)
                one.page.wait_for_function("window.after_600_ms !== undefined")
                assert one.page.evaluate("[window.after_250_ms, window.after_600_ms]") == [0, 1]
        finally:
            process.send_signal(signal.SIGCONT)
        for one in viewers:
            works_again(one)


#: Checks the alarm with the page's own timers, whose order does not depend on the load.
_LOOKS = """() => addEventListener('touchstart', () => {
    const shown = () => document.querySelector('#stop-failed').hidden ? 0 : 1;
    setTimeout(() => { window.after_250_ms = shown() }, 250);
    setTimeout(() => { window.after_600_ms = shown() }, 600);
}, { capture: true, once: true })"""


def test_reloaded_page_repeats_an_undelivered_stop(browser: Browser, address: str) -> None:
    with viewer(browser, address, "laptop") as one:
        page = one.page
        # The page's clock is stopped, so the loading time does not matter.
        page.add_init_script("Date.now = () => 1e12")
        page.evaluate("Date.now = () => 1e12")
        page.route("**/stop", lambda route: route.abort())
        page.touchscreen.tap(*one.middle)
        alarmed(one)
        page.unroute("**/stop")
        with page.expect_response(lambda reply: reply.url.endswith("/stop") and reply.ok):
            page.reload()
        page.wait_for_function("sessionStorage.getItem('palpate-stop') === null")
        asked = len(one.asked)
        page.reload()
        fresh(page)
        assert len(one.asked) == asked


#: Sends a stop, then a press of Grasp from a page that does not know the stop yet.
OVERTAKEN = """async () => {
    await fetch('/stop', { method: 'POST' });
    document.getElementById('grasp').click();
}"""


def test_grasp_pressed_before_a_stop_does_not_start_after_the_stop(
    browser: Browser, address: str
) -> None:
    with viewer(browser, address, "laptop") as one:
        page = one.page
        drive(page)
        expect(page.locator("#grasp")).to_be_enabled()
        # Until a request fails, an earlier response may still inform the page about the stop.
        with page.expect_event("requestfailed", lambda request: "/live?" in request.url):
            page.route("**/live?*", lambda route: route.abort())
        page.evaluate(OVERTAKEN)
        expect(page.locator(".q-notification")).to_contain_text("stopped before it started")
        page.unroute("**/live?*")
        fresh(page)
        expect(page.locator("#verdict-text")).to_have_text("ready")


def test_page_without_a_socket_reports_it_and_buffers_no_press(
    browser: Browser, address: str
) -> None:
    """Without the socket, a buffered press would move the hand later."""
    with viewer(browser, address, "laptop") as one:
        page = one.page
        drive(page)
        expect(page.locator("#grasp")).to_be_enabled()
        page.evaluate("window.socket.disconnect(); document.getElementById('grasp').click()")
        expect(page.locator("#lost-title")).to_have_text("No connection")
        expect(page.locator("#lost-why")).to_contain_text("Only STOP can be sent")
        expect(page.locator("#lost-why")).not_to_contain_text("values shown are outdated")
        asked = len(one.asked)
        page.mouse.click(*one.middle)
        one.confirmed(after=asked)
        page.evaluate("window.socket.connect()")
        expect(page.locator("#lost")).to_be_hidden()
        expect(page.locator("#verdict-text")).to_have_text("ready")
        drive(page)
        page.locator("#grasp").click()
        expect(page.locator("body")).to_have_attribute("data-activity", "grasping")
        page.mouse.click(*one.middle)
        one.confirmed(after=asked + 1)
        expect(page.locator("body")).to_have_attribute("data-activity", "watching")
        release(page)


def test_page_press_that_arrives_late_does_not_move_the_hand(
    browser: Browser, address: str
) -> None:
    def late(route: Route) -> None:
        reply = route.fetch()
        told = reply.json()
        route.fulfill(response=reply, json=told | {"server_s": told["server_s"] - 10.0})

    with viewer(browser, address, "laptop") as one:
        page = one.page
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
    with serving(tmp_path, *SIMULATED) as (url, process), viewer(browser, url, "laptop") as one:
        children = children_of(process.pid)
        signalled(children, signal.SIGSTOP)
        try:
            greyed(one, "The devices do not respond")
            expect(one.page.locator("#grasp")).to_be_disabled()
            one.page.mouse.click(*one.middle)
            alarmed(one)
        finally:
            signalled(children, signal.SIGCONT)
        one.confirmed(after=0)
        expect(one.page.locator("#verdict")).to_be_visible()


def signalled(children: list[int], number: signal.Signals) -> None:
    for child in children:
        os.kill(child, number)
