"""The dashboard in a browser, on simulated rigs behind a real server."""

from __future__ import annotations

import json
import os
import re
import threading
import tty
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from benchmarks.dashboard import ROOT, write_rig
from packages.station.tests.served_pages import (
    ITEM,
    SLOWER,
    STRAWBERRY,
    TARGET,
    WIDE,
    Machine,
    drive,
    expect_enabled,
    expect_fresh_link,
    expect_verdict,
    grasp,
    open_tab,
    release,
    serve_dashboard,
    start_grasp,
    visit,
    visit_as_driver,
    wait_for_draws,
)
from playwright.sync_api import Browser, Page, expect

from palpate.recording import load_recording
from palpate_studies.benchmarks.pty_board import run_board


@pytest.fixture(scope="module")
def page(browser: Browser, address: str) -> Iterator[Page]:
    with visit_as_driver(browser, address) as page:
        yield page


@pytest.fixture
def driver(page: Page, address: str) -> Iterator[Page]:
    """The page of the driver at its first tab; a test leaves its hand open."""
    open_tab(page, "Set up")
    drive(page)
    expect(page.locator("#who")).to_contain_text("you control")
    yield page
    Machine(address).leave_hand_open()


@pytest.fixture
def open_page(browser: Browser, address: str) -> Iterator[Callable[..., Page]]:
    """Open the dashboard in a new browser context, as another viewer."""
    with ExitStack() as stack:

        def open_page(url: str = address, **options: object) -> Page:
            return stack.enter_context(visit(browser, url, **options))

        yield open_page


#: Keeps the half-width of every forecast that is drawn during a grasp, percent.
KEEP_HALF_WIDTHS = """() => {
    const curve = document.querySelector('#curve');
    window.halves = [];
    new MutationObserver(() => {
        if (document.body.dataset.activity === 'grasping' && +curve.dataset.bands)
            window.halves.push(+curve.dataset.halfWidth);
    }).observe(curve, { attributes: true, attributeFilter: ['data-half-width'] });
}"""


def test_grasp_narrows_the_forecast_band_and_shows_the_verdict(driver: Page) -> None:
    driver.get_by_label(TARGET).fill("3")
    driver.evaluate(KEEP_HALF_WIDTHS)
    start_grasp(driver)
    expect_verdict(driver, "holding")
    # A busy page may draw only the last ones.
    driver.wait_for_function("window.halves.length && window.halves.at(-1) <= window.halves[0]")
    expect(driver.locator("#curve-settles")).to_contain_text("forecast −")
    expect(driver.locator("#force-settles")).to_contain_text(re.compile(r"forecast \d"))
    expect(driver.locator("#chart")).not_to_have_attribute("data-moves", "0")
    expect(driver.locator("#simulated")).to_be_visible()
    card = driver.locator("#measure-force_n")
    expect(card).to_contain_text("Grip force now")
    expect(card).to_contain_text(re.compile(r"answer \d\.\d+ N"))
    expect(driver.locator("#force .level.target")).to_have_attribute("data-value", "3")
    expect(driver.locator("#moments [data-name=answer]")).to_be_attached()
    expect(driver.locator("#moments [data-name=finger_contact]")).to_have_count(2)
    expect(driver.locator("#fingers .pad.touching")).to_have_count(2)
    for curve, unit in (("force", "N"), ("curve", "%")):
        driver.locator(f"#{curve} .u-over").hover()
        at = driver.locator(f"#{curve}-at")
        expect(at).to_have_text(re.compile(rf"^\d+\.\d s: .*\d {unit}"))
        expect(at).to_have_class(re.compile("pointed"))
    driver.mouse.move(5, 5)
    expect(driver.locator("#force-at")).to_have_text(re.compile(r"^\d+\.\d\d N \["))
    release(driver)
    expect_verdict(driver, "held and released")
    expect(driver.locator("#fingers .pad.touching")).to_have_count(0)
    # The forecast band ends when the hand opens.
    driver.wait_for_function(
        "+document.querySelector('#curve').dataset.bandEnd"
        " <= +document.querySelector('#moments [data-name=held]')?.dataset.at + 0.2"
    )
    expect(driver.locator("#verdict")).to_have_attribute("data-kind", "good")
    # The page runs in real time, so the same squeeze may end with a bound or a number.
    answer = json.loads(driver.evaluate("fetch('/api/result').then(reply => reply.text())"))
    stiffness = answer["stiffness_n_per_mm"]
    value = driver.locator("#measure-stiffness_n_per_mm .value")
    if stiffness["value"] is None:
        expect(value).to_contain_text(f"at least {stiffness['low']:.2f}")
    else:
        expect(value).to_contain_text(f"{stiffness['value']:.2f}")
    expect(driver.locator("#verdict .firm")).to_have_text(answer["verdict"]["firmness"])
    for name in ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent"):
        expect(driver.locator(f"#measure-{name} .range").first).to_contain_text("true")
    expect(driver.locator("#firmness")).to_have_text(
        re.compile(rf"firmness {answer['firmness']['value']:.0f} of 100 \[")
    )
    driver.get_by_label(TARGET).fill("")


#: Limits of the chart's time range, seconds from the contact.
TIME_RANGE = "() => ['start', 'end'].map((end) => +document.querySelector('#chart').dataset[end])"


#: Stored force curves of finished grasps, and the newest of them if there are more than before.
STORED = """Object.entries(localStorage).filter(([key]) => key.includes('ghosts'))
    .flatMap(([, curves]) => JSON.parse(curves))"""
COUNT_STORED = f"{STORED}.length"
LAST_STORED = f"(before) => {{ const all = {STORED}; return all.length > before && all.at(-1); }}"


def test_finished_grasp_stays_on_the_chart_with_zoom_and_cursor(
    open_page: Callable[..., Page], driver: Page, address: str
) -> None:
    stored_before = driver.evaluate(COUNT_STORED)
    grasp(driver)
    # Force over closing is drawn from the readings received by this page.
    press = driver.locator("#press")
    expect(press).to_have_attribute("aria-label", re.compile("stiffness .*N/mm"))
    release(driver)
    chart, force = driver.locator("#chart"), driver.locator("#force .u-over")
    expect(chart).to_have_attribute("data-frozen", "true")
    expect(press).to_have_attribute("aria-label", re.compile("stiffness .*N/mm"))
    # The force up to the release is stored for the envelope of the next grasps.
    stored = driver.wait_for_function(LAST_STORED, arg=stored_before).json_value()
    assert len(stored) == pytest.approx(10 * min(released_s(driver), 30.0), abs=1.5)
    released = driver.locator("#moments [data-name=held]").get_attribute("data-at")
    frozen = [-2.0, pytest.approx(float(released or "nan") + 3.0, abs=0.02)]
    driver.wait_for_function(f"() => ({TIME_RANGE})()[1] > {released} + 2.97")
    wait_for_draws(driver, 20)
    assert driver.evaluate(TIME_RANGE) == frozen
    box = force.bounding_box()
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    # The cursor is shown on both plots, and the hand is drawn for the time of the cursor.
    driver.mouse.move(*middle)
    reading = re.compile(r"^\d+\.\d s: \d\.\d\d N \[")
    expect(driver.locator("#force-at")).to_have_text(reading)
    expect(driver.locator("#curve-at")).to_have_text(re.compile(r"^\d+\.\d s: −\d+\.\d %"))
    expect(driver.locator("#fingers-title")).to_have_text(re.compile(r"^Fingers at \d+\.\d s$"))
    expect(driver.locator("#fingers")).not_to_contain_text("74.0 mm apart")
    driver.mouse.wheel(0, -300)
    wheeled = driver.evaluate(TIME_RANGE)
    assert wheeled[0] > -2.0
    assert wheeled[1] < released_s(driver) + 2.9
    driver.mouse.down()
    driver.mouse.move(middle[0] + box["width"] / 4, middle[1], steps=4)
    driver.mouse.up()
    dragged = driver.evaluate(TIME_RANGE)
    assert dragged[1] - dragged[0] < 0.5 * (wheeled[1] - wheeled[0])
    expect(driver.locator("#unzoom")).to_be_visible()
    driver.mouse.dblclick(*middle)
    assert driver.evaluate(TIME_RANGE) == frozen
    for view in ("30 s", "All"):
        driver.get_by_role("button", name=view, exact=True).click()
        expect(chart).to_have_attribute("data-frozen", "false")
    # Keyboard: the cursor is a slider that reports time and value.
    driver.locator("[data-view=grasp]").click()
    slider = driver.get_by_role("slider", name="Grip force over time")
    slider.focus()
    for _ in range(12):
        slider.press("ArrowLeft")
    expect(slider).to_have_attribute("aria-valuetext", reading)
    slider.press("PageUp")
    assert driver.evaluate(TIME_RANGE) != frozen
    slider.press("Home")
    assert driver.evaluate(TIME_RANGE) == frozen
    # A click on the small plot of a pixel selects the pixel.
    driver.locator("#pixels").click(position={"x": 10, "y": 10})
    expect(driver.locator("#pixel-name")).to_have_text("row 1, column 1")
    driver.locator("#pixel-close").click()
    # Pinch with two fingers.
    touch_page = open_page("about:blank", has_touch=True)
    with touch_page.expect_response("**/live?*") as first:
        touch_page.goto(address)
    expect(touch_page.locator("#chart")).to_have_attribute("data-frozen", "true")
    before = touch_page.evaluate(TIME_RANGE)
    assert before == frozen
    # This page was opened after the grasp, but receives and draws pixels and hand of the whole
    # grasp. Their number depends on the time since the grasp, which is in the same document.
    document = first.value.json()
    past_s = np.array([one["time_s"] for one in document["past"]]) - document["grasp"]["touched_s"]
    shown_s = past_s[(past_s >= before[0]) & (past_s <= before[1])]
    assert np.diff([before[0], *shown_s, before[1]]).max() < 1.0
    drawn = int(touch_page.locator("#pixels").get_attribute("data-moments") or 0)
    assert drawn == pytest.approx(len(shown_s), abs=1)
    touch_page.evaluate(PINCH)
    after = touch_page.evaluate(TIME_RANGE)
    assert after[1] - after[0] == pytest.approx((before[1] - before[0]) / 2, rel=0.1)


def released_s(page: Page) -> float:
    """Return the opening time of the hand, seconds from the contact."""
    return float(page.locator("#moments [data-name=held]").get_attribute("data-at") or "nan")


#: Moves two fingers on the plot to twice their distance.
PINCH = """() => {
    const plot = document.querySelector('#curve .u-over'), box = plot.getBoundingClientRect();
    const touch = (identifier, fraction) => new Touch({ identifier, target: plot,
        clientX: box.left + fraction * box.width, clientY: box.top + 5 });
    for (const [type, shares] of [['touchstart', [0.4, 0.6]], ['touchmove', [0.3, 0.7]]]) {
        plot.dispatchEvent(new TouchEvent(type, { cancelable: true,
            touches: shares.map((fraction, i) => touch(i, fraction)) }));
    }
}"""


#: Whether the fingers of this grasp move; the marks may belong to the previous grasp.
CLOSES = (
    "parseFloat(document.querySelector('#fingers').textContent.match(/([0-9.]+) mm apart/)[1]) < 72"
)


def test_stop_mid_grasp_shows_the_halted_hand_and_opens_it_on_release(
    driver: Page, address: str, folder: Path
) -> None:
    start_grasp(driver)
    driver.wait_for_function(CLOSES)
    driver.locator("#stop").click()
    expect_verdict(driver, "stopped on request")
    # The page shows only the latency of the press, on the button.
    expect(driver.locator("#stop-state")).to_have_text(re.compile(r"^confirmed after \d+ ms$"))
    expect(driver.locator("#verdict .why")).not_to_contain_text(" ms")
    Machine(address).until(lambda at: at["activity"] == "watching")
    newest = max((folder / "data").glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    # The hand stays at its last recorded width. The browser rounds half a tenth up, Python to even.
    ends_mm = load_recording(newest).gripper.width_mm[-1]
    assert 5.0 < ends_mm < 73.0
    shown = {f"{ends_mm + half_mm:.1f} mm apart" for half_mm in (-1e-6, 1e-6)}
    expect(driver.locator("#fingers")).to_contain_text(re.compile("|".join(map(re.escape, shown))))
    expect(driver.locator("#grasp")).to_be_disabled()
    release(driver)
    expect(driver.locator("#fingers")).to_contain_text("74.0 mm apart")
    expect_verdict(driver, "stopped, gripper open")
    expect(driver.locator("#verdict")).to_have_attribute("data-kind", "idle")
    # A stop that comes late finds an answer, which stays on its card.
    answer = Machine(address).ask("GET", "/result")[1]["force_n"]
    force = "gripper open" if answer is None else " N"
    expect(driver.locator("#measure-force_n .value")).to_contain_text(force)


def test_second_viewer_can_watch_stop_and_take_over(
    driver: Page, open_page: Callable[..., Page]
) -> None:
    second = open_page(viewport={"width": 820, "height": 1180})
    expect_fresh_link(second)
    expect(second.locator("#who")).to_have_text("you watch")
    expect(second.locator("#grasp")).to_be_disabled()
    expect(second.locator("#release")).to_be_disabled()
    expect(driver.locator("#who")).to_contain_text("1 watching")
    # Only the driver can change the settings of the next grasp.
    driver.get_by_label(TARGET).fill("2")
    for label in (TARGET, ITEM):
        expect(second.get_by_label(label)).to_be_disabled()
    expect(second.get_by_label(TARGET)).to_have_value("2")
    second.keyboard.type("B2")
    second.keyboard.press("F8")
    expect(driver.get_by_label(ITEM)).to_have_value("")
    driver.get_by_label(TARGET).fill("")
    start_grasp(driver)
    second.wait_for_function(CLOSES)
    second.locator("#stop").click()
    for page in (driver, second):
        expect_verdict(page, "stopped on request")
    second.locator("#take-over").click()
    expect(second.locator("#who")).to_contain_text("you control")
    expect(driver.locator("#who")).to_have_text("you watch")
    expect(driver.get_by_text("Another screen controls now")).to_be_visible()
    expect(driver.locator("#release")).to_be_disabled()
    release(second)


#: Delays every response.
_DELAY_RESPONSES = """(late_ms) => {
    const asked = window.fetch;
    window.fetch = (...what) => new Promise((answer, refuse) => {
        what[1]?.signal?.addEventListener('abort', () => refuse(what[1].signal.reason));
        asked(...what).then((reply) => setTimeout(answer, late_ms, reply), refuse);
    });
}"""
#: Suppresses the next response, as after an undetected network failure. Resolves to whether a later
#: response updated the page in the meantime.
_LOSE_ONE_RESPONSE = """() => new Promise((resolve) => {
    const asked = window.fetch;
    window.fetch = (...what) => {
        if (!String(what[0]).startsWith('/live')) return asked(...what);
        window.fetch = asked;
        return new Promise((_, refuse) => {
            const drawn = Number(document.body.dataset.drawn);
            what[1].signal.addEventListener('abort', () => {
                resolve(Number(document.body.dataset.drawn) > drawn);
                refuse(what[1].signal.reason);
            });
        });
    };
})"""


def test_slow_connection_is_reported_and_the_page_is_still_updated(
    open_page: Callable[..., Page],
) -> None:
    page = open_page()
    expect_fresh_link(page)
    # A missing response does not delay later requests.
    assert page.evaluate(_LOSE_ONE_RESPONSE)
    # The age of the last frame includes the delay of the network.
    page.evaluate(_DELAY_RESPONSES, 600)
    age = re.compile(r"last frame ([6-9]\d\d ms|\d+\.\d s) ago")
    expect(page.locator("#link-age")).to_have_text(age)
    wait_for_draws(page, 2)
    assert age.fullmatch(page.locator("#link-age").inner_text().strip("· "))
    page.evaluate(_DELAY_RESPONSES, 1000)
    expect(page.locator("#lost-title")).to_have_text("No connection")
    wait_for_draws(page, 1)
    expect(page.locator("#lost")).to_be_visible()


def test_rest_calibration_and_doctor_show_their_results(driver: Page, folder: Path) -> None:
    open_tab(driver, "Calibrate")
    expect_enabled(driver, "#calibrate-rest")
    driver.locator("#calibrate-rest").click()
    expect(driver.locator("#guide")).to_contain_text("Do not touch the sensor")
    driver.evaluate("scrollTo(0, 0)")
    stop = driver.locator("#stop").bounding_box()
    assert stop["y"] + stop["height"] <= WIDE["height"]
    expect(driver.locator("#calibrated")).to_contain_text("Calibrated")
    expect(driver.locator("#calibrated td[title]")).to_have_count(16)
    expect(driver.locator("#force-in-use")).to_contain_text("Made ")
    figure = driver.get_by_role("img", name="Current force calibration and its errors")
    expect(figure).to_be_visible()
    assert (folder / "data" / "calibration-sim-rigid-3.json").exists()
    open_tab(driver, "Doctor")
    expect_enabled(driver, "#examine")
    driver.locator("#examine").click()
    expect(driver.locator("#health")).to_contain_text("frames in 10")
    maps = driver.locator("#health .heat")
    expect(maps).to_have_count(3)
    expect(maps.first.locator("td[title]")).to_have_count(8)


def expect_tab(page: Page, name: str) -> None:
    expect(page.get_by_role("tab", name=name)).to_have_attribute("aria-selected", "true")


def test_every_tab_has_a_url_and_reload_keeps_the_driver(driver: Page, address: str) -> None:
    for name in ("Calibrate", "Doctor"):
        open_tab(driver, name)
        expect_tab(driver, name)
    expect(driver).to_have_url(f"{address}doctor")
    driver.evaluate("window.same = true")
    for name, path in (("Calibrate", "calibrate"), ("Set up", "")):
        driver.go_back()
        expect_tab(driver, name)
        expect(driver).to_have_url(f"{address}{path}")
    assert driver.evaluate("window.same"), "the page must not be reloaded"
    open_tab(driver, "Recordings")
    expect(driver).to_have_url(f"{address}recordings")
    # The URL is not replaced when the store is read again, every three seconds.
    wait_for_draws(driver, 60)
    expect(driver).to_have_url(f"{address}recordings")
    expect(driver.locator("#who")).to_contain_text("you control")
    driver.reload()
    expect_fresh_link(driver)
    expect_tab(driver, "Recordings")
    expect(driver.locator("#who")).to_contain_text("you control")
    driver.goto(f"{address}items/A%2F1")
    expect_tab(driver, "Items")
    expect(driver.locator(".q-tab-panel")).to_contain_text("A/1")


#: Overlap of the object's text with the pads, pixels.
OVERLAP_WITH_PADS = """() => {
    const boxes = (what) => [...document.querySelectorAll(`#fingers ${what}`)]
        .map((one) => one.getBoundingClientRect());
    return boxes('.thing').flatMap((words) => boxes('.sheet').map((pad) =>
        Math.min(words.right, pad.right) - Math.max(words.left, pad.left)));
}"""


def test_soft_gripper_page_shows_the_held_object_and_fits_the_screen(
    browser: Browser, tmp_path: Path
) -> None:
    rig = ("--rig", "sim-soft", *STRAWBERRY, "--rate-hz", "15", *SLOWER)
    with (
        serve_dashboard(tmp_path, *rig) as address,
        visit_as_driver(browser, address, viewport={"width": 390, "height": 768}) as page,
    ):
        # No previous grasp is shown, and without a load cell the force can't be calibrated.
        open_tab(page, "Calibrate")
        expect(page.locator("#calibrate-rest")).to_be_visible()
        expect(page.locator("#calibrate-force")).to_be_hidden()
        grasp(page)
        for width in (320, 1024, 390):
            page.set_viewport_size({"width": width, "height": 768})
            wait_for_draws(page, 2)
            expect(page.locator("#fingers .thing")).not_to_have_count(0)
            expect(page.locator("#fingers .thing").first).to_have_text(re.compile("held|mm"))
            expect(page.locator("#fingers .centre:not(.hidden)")).to_have_count(2)
            assert max(page.evaluate(OVERLAP_WITH_PADS)) <= 0
            for name in ("Set up", "Calibrate", "Recordings", "Items", "Run"):
                open_tab(page, name)
                expect_tab(page, name)
                assert page.evaluate("document.documentElement.scrollWidth") <= width
        release(page)
        # After reopening the rig, the idle page shows the last grasp.
        open_tab(page, "Set up")
        expect_enabled(page, "#use-rig")
        page.locator("#use-rig").click()
        expect_fresh_link(page)
        words = re.compile(r"last grasp .*: held.*·\stoday 1 held")
        expect(page.locator("#verdict-why")).to_have_text(words)


def test_page_loads_no_external_files_and_is_usable_by_keyboard(
    open_page: Callable[..., Page], address: str
) -> None:
    page = open_page("about:blank", color_scheme="dark")
    requested: list[str] = []
    page.on("request", lambda request: requested.append(request.url))
    page.goto(address)
    expect_fresh_link(page)
    assert {url for url in requested if not url.startswith((address, "data:"))} == set()
    # Static files are compressed, but polled documents are not.
    for path, encoding in (("static/chart.js", "gzip"), ("live", None)):
        request = urllib.request.Request(f"{address}{path}", headers={"Accept-Encoding": "gzip"})
        with urllib.request.urlopen(request, timeout=30) as reply:
            assert reply.headers.get("content-encoding") == encoding
    for shade in ("light", "dark"):
        page.locator("#shade").click()
        expect(page.locator("body")).to_have_class(re.compile(f"body--{shade}"))
    drive(page)
    expect_enabled(page, "#grasp")
    reached: set[str] = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.innerText"))
    assert {"grasp", "release", "stop", "use-rig", "shade"} <= reached


def test_page_beyond_the_loopback_requires_a_token_and_reports_a_lost_server(
    open_page: Callable[..., Page], tmp_path: Path
) -> None:
    with serve_dashboard(tmp_path, "--host", "0.0.0.0", PALPATE_TOKEN="correct-horse") as address:
        # The external URL, because "0.0.0.0" is not reachable.
        assert "0.0.0.0" not in address
        page = open_page("about:blank")
        answer = page.goto(address)
        assert answer.status == 401
        page.get_by_label("Token").fill("wrong-horse")
        page.get_by_role("button", name="Enter", exact=True).click()
        expect(page.locator("body")).to_contain_text("Wrong token.")
        page.get_by_label("Token").fill("correct-horse")
        page.get_by_role("button", name="Enter", exact=True).click()
        expect(page.locator("#link")).to_be_visible()
    expect(page.locator("#link")).to_have_attribute("data-state", "stale")
    expect(page.locator("#link-text")).to_contain_text("NO CONNECTION")
    expect(page.locator("#lost-why")).to_contain_text("palpate serve does not answer")


def test_unplugged_board_sets_the_link_to_stale(
    open_page: Callable[..., Page], tmp_path: Path
) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    plugged = threading.Thread(target=lambda: run_until_unplugged(master), daemon=True)
    plugged.start()
    # Served through a link, because the kernel reuses the number of a closed terminal, and the
    # server tries to reopen its port.
    port = tmp_path / "board"
    port.symlink_to(os.ttyname(slave))
    rig = write_rig(tmp_path, port=str(port), rate_hz=100.0)
    with serve_dashboard(tmp_path, "--rig", str(rig), PYTHONPATH=str(ROOT)) as address:
        page = open_page(address)
        expect_fresh_link(page)
        expect(page.locator("#simulated")).to_be_hidden()
        port.unlink()
        os.close(slave)
        os.close(master)
        expect(page.locator("#link")).to_have_attribute("data-state", "stale")
        expect(page.locator("#link-text")).to_contain_text("NO FRAMES")
        expect_verdict(page, "the sensor is silent")
        expect(page.locator("#verdict .why")).to_contain_text("check its cable and power")
        expect(page.locator("#grasp")).to_be_disabled()
    plugged.join(10)


def run_until_unplugged(master: int) -> None:
    try:
        run_board(master, rate_hz=100.0)
    except OSError:
        return
