"""The dashboard in a browser, on simulated rigs behind a real server."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import tty
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from time import monotonic
from typing import Any, cast

import pytest
from benchmarks.dashboard import ROOT, children_of, write_rig
from playwright.sync_api import Browser, Page, expect, sync_playwright
from tests.closings import write_damage_file
from tests.conftest import skip

from palpate.recording import load_recording
from palpate_studies.benchmarks.pty_board import run_board

#: Label of the item's field on the page, with a hint if it is empty.
ITEM = re.compile(r"^Item(:|$)")

CHROMIUM = Path("/usr/bin/chromium")
WIDE, TABLET = {"width": 1280, "height": 800}, {"width": 820, "height": 1180}
STRAWBERRY = ("--object", "strawberry", "--seed", "3")
#: Few frames a second, because simulated time runs faster than real time.
SIMULATED = ("--rig", "sim-rigid", *STRAWBERRY, "--speed", "10", "--rate-hz", "15")
SERVE = (sys.executable, "-W", "error", "-c", "from palpate.cli import main; main()", "serve")
#: Timeout of the pages, milliseconds; an idle machine requires one or two seconds.
TIMEOUT_MS = 60_000


@contextmanager
def serve_dashboard(folder: Path, *options: str, **environment: str) -> Iterator[str]:
    """Serve a dashboard; yield its URL."""
    with run_server(folder, *options, **environment) as (address, _):
        yield address


@contextmanager
def run_server(
    folder: Path, *options: str, **environment: str
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Serve a dashboard; yield its URL and process."""
    command = [*SERVE, "--port", "0", "--folder", str(folder / "data"), *options]
    command += ["--store", str(folder / "items.sqlite")]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, cwd=folder, env=os.environ | environment
    ) as process:
        try:
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found is not None, "the server did not start"
            yield found[0], process
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    if not CHROMIUM.exists():
        skip(f"no {CHROMIUM}: apt-get install chromium")
    expect.set_options(timeout=TIMEOUT_MS)
    with sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("served")


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    """A dashboard shared by all tests that leave its hand open."""
    with serve_dashboard(folder, *SIMULATED) as address:
        yield address


@pytest.fixture(autouse=True)
def hand_left_open(address: str) -> Iterator[None]:
    """Open the hand and give up control after each test."""
    yield
    reset_session(address)


def reset_session(address: str) -> None:
    """Stop the running job, open the hand, and give up control."""
    ask(address, "PUT", "driver")
    state = ask(address, "GET", "state")
    if state["activity"] != "watching":
        ask(address, "POST", "stop")
        state = wait_until(address, lambda state: state["activity"] in ("watching", "no rig"))
    if state["hand_open"] is False:
        ask(address, "POST", "release")
        wait_until(address, lambda state: state["activity"] == "watching" and state["hand_open"])
    ask(address, "DELETE", "driver")


def ask(address: str, method: str, path: str) -> Any:
    """Return the JSON of an API response; None for an empty response."""
    request = urllib.request.Request(f"{address}api/{path}", method=method)
    with urllib.request.urlopen(request, timeout=TIMEOUT_MS / 1000) as reply:
        return json.loads(reply.read() or "null")


def wait_until(address: str, is_reached: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """Return the first state that fulfils a condition."""
    deadline = monotonic() + TIMEOUT_MS / 1000
    while not is_reached(state := ask(address, "GET", "state")):
        assert monotonic() < deadline, f"the state stayed {state}"
    return cast("dict[str, Any]", state)


@pytest.fixture
def open_page(browser: Browser, address: str) -> Iterator[Callable[..., Page]]:
    """Open the dashboard in a new browser context, as another viewer."""
    contexts = []

    def open_page(url: str = address, **options: object) -> Page:
        contexts.append(browser.new_context(**{"viewport": WIDE, **options}))
        page = contexts[-1].new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(url)
        return page

    yield open_page
    for context in contexts:
        context.close()


@pytest.fixture
def driver(open_page: Callable[..., Page]) -> Page:
    """The page of a driver, with an open rig and no running job."""
    page = open_page()
    expect_fresh_link(page)
    drive(page)
    expect(page.locator("#who")).to_contain_text("you drive")
    expect(page.locator("#verdict-text")).to_be_visible()
    return page


def drive(page: Page) -> None:
    """Take control, unless the page already has it or gets it just before the click."""
    page.evaluate(
        "() => { const take = document.getElementById('take-over');"
        " if (take.checkVisibility()) take.click(); }"
    )
    expect(page.locator("#take-over")).to_be_hidden()


def expect_fresh_link(page: Page) -> None:
    expect(page.locator("#link")).to_have_attribute("data-state", "fresh")


def expect_verdict(page: Page, words: str | re.Pattern[str]) -> None:
    expect(page.locator("#verdict-text")).to_have_text(words)


def expect_enabled(page: Page, button: str) -> None:
    expect(page.locator(button)).to_be_enabled()


def open_tab(page: Page, name: str) -> None:
    page.get_by_role("tab", name=name).click()


def grasp(page: Page) -> None:
    expect_enabled(page, "#grasp")
    page.locator("#grasp").click()
    expect_verdict(page, "holding")


def release(page: Page) -> None:
    page.locator("#release").click()
    expect_enabled(page, "#grasp")


def test_grasp_narrows_the_forecast_band_and_shows_the_verdict(driver: Page) -> None:
    expect_enabled(driver, "#grasp")
    driver.locator("#grasp").click()
    half_widths = []
    for count in (1, 8):
        driver.wait_for_function(
            "count => +document.querySelector('#curve')?.dataset.bands >= count", arg=count
        )
        half_widths.append(
            float(driver.locator("#curve").get_attribute("data-half-width") or "nan")
        )
    assert 0 < half_widths[1] < 0.8 * half_widths[0]
    expect_verdict(driver, "holding")
    expect(driver.locator("#curve-settles")).to_contain_text("settles at −")
    expect(driver.locator("#chart")).not_to_have_attribute("data-moves", "0")
    expect(driver.locator("#simulated")).to_be_visible()
    release(driver)
    expect_verdict(driver, "held and released")
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


#: Limits of the chart's time range, seconds from the contact.
TIME_RANGE = "() => ['start', 'end'].map((end) => +document.querySelector('#chart').dataset[end])"


def test_finished_grasp_stays_on_the_chart_with_zoom_and_cursor(
    open_page: Callable[..., Page], driver: Page
) -> None:
    grasp(driver)
    # Force over closing is drawn from the readings received by this page.
    press = driver.locator("#press")
    expect(press).to_have_attribute("aria-label", re.compile("object: .*N/mm"))
    release(driver)
    chart, force = driver.locator("#chart"), driver.locator("#force .u-over")
    expect(chart).to_have_attribute("data-frozen", "true")
    expect(press).to_have_attribute("aria-label", re.compile("object: .*N/mm"))
    # The force up to the release is stored for the envelope of the next grasps.
    driver.wait_for_function("Object.keys(localStorage).some((key) => key.includes('ghosts'))")
    (stored,) = driver.evaluate(
        "JSON.parse(Object.entries(localStorage).find(([key]) => key.includes('ghosts'))[1])"
    )
    assert len(stored) == pytest.approx(10 * min(released_s(driver), 30.0), abs=1.5)
    released = driver.locator("#moments [data-name=held]").get_attribute("data-at")
    frozen = [-2.0, pytest.approx(float(released or "nan") + 3.0, abs=0.02)]
    driver.wait_for_function(f"() => ({TIME_RANGE})()[1] > {released} + 2.97")
    drawn = driver.evaluate("+document.body.dataset.drawn")
    driver.wait_for_function("(before) => +document.body.dataset.drawn > before + 20", arg=drawn)
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
    expect(driver.locator("#pixel-name")).to_have_text("R0 C0")
    driver.locator("#pixel-close").click()
    # Pinch with two fingers.
    touch_page = open_page(has_touch=True)
    expect(touch_page.locator("#chart")).to_have_attribute("data-frozen", "true")
    before = touch_page.evaluate(TIME_RANGE)
    assert before == frozen
    # This page was opened after the grasp, but receives pixels and hand of the whole grasp.
    assert int(touch_page.locator("#pixels").get_attribute("data-moments") or 0) > 20
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


def test_force_plot_shows_the_current_force_and_the_controller_events(driver: Page) -> None:
    driver.get_by_label("Target force, N (empty: a gentle squeeze)").fill("3")
    grasp(driver)
    card = driver.locator("#measure-force_n")
    expect(card).to_contain_text("Grip force now")
    expect(card).to_contain_text(re.compile(r"answer \d\.\d+ N"))
    expect(driver.locator("#force-settles")).to_contain_text(re.compile(r"settles at \d"))
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
    expect(card).to_contain_text("true")
    expect(driver.locator("#fingers .pad.touching")).to_have_count(0)
    driver.get_by_label("Target force, N (empty: a gentle squeeze)").fill("")


#: Whether the fingers of this grasp move; the marks may belong to the previous grasp.
CLOSES = (
    "parseFloat(document.querySelector('#fingers').textContent.match(/([0-9.]+) mm apart/)[1]) < 72"
)


@pytest.mark.parametrize("how", ["button", "key"])
def test_stop_mid_grasp_stops_the_twin_within_100_ms(driver: Page, folder: Path, how: str) -> None:
    expect_enabled(driver, "#grasp")
    driver.locator("#grasp").click()
    expect(driver.locator(".pixel").first).to_be_visible()
    driver.wait_for_function(CLOSES)
    if how == "button":
        driver.locator("#stop").click()
    else:
        driver.keyboard.press("Escape")
    expect_verdict(driver, "stopped on request")
    # The verdict is shown with the last state, the duration of the stop after the end of the order.
    state = driver.wait_for_function(
        """async () => {
            const state = await fetch('/api/state').then((reply) => reply.json());
            return state.activity === 'watching' ? state : null;
        }"""
    ).json_value()
    assert state["stopped_after_s"] <= 0.1
    # The page shows only the latency of the press, on the button.
    expect(driver.locator("#stop-state")).to_have_text(re.compile(r"^confirmed after \d+ ms$"))
    expect(driver.locator("#verdict .why")).not_to_contain_text(" ms")
    newest = max((folder / "data").glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    recorded = load_recording(newest)
    assert 5.0 < recorded.gripper.width_mm[-1] < 73.0
    # The hand stays at its last recorded width. The browser rounds half a tenth up, Python to even.
    ends_mm = recorded.gripper.width_mm[-1]
    shown = {f"{ends_mm + half_mm:.1f} mm apart" for half_mm in (-1e-6, 1e-6)}
    expect(driver.locator("#fingers")).to_contain_text(re.compile("|".join(map(re.escape, shown))))
    expect(driver.locator("#grasp")).to_be_disabled()
    release(driver)
    expect(driver.locator("#fingers")).to_contain_text("74.0 mm apart")
    expect_verdict(driver, "stopped, hand open")
    expect(driver.locator("#verdict")).to_have_attribute("data-kind", "idle")
    expect(driver.locator("#measure-force_n .value")).to_contain_text("hand open")


def test_second_viewer_can_watch_stop_and_take_over(
    driver: Page, open_page: Callable[..., Page]
) -> None:
    second = open_page(viewport=TABLET)
    expect_fresh_link(second)
    expect(second.locator("#who")).to_have_text("you watch")
    expect(second.locator("#grasp")).to_be_disabled()
    expect(second.locator("#release")).to_be_disabled()
    expect(driver.locator("#who")).to_contain_text("1 watches")
    # Only the driver can change the settings of the next grasp.
    driver.get_by_label("Target force, N (empty: a gentle squeeze)").fill("2")
    for label in ("Target force, N (empty: a gentle squeeze)", ITEM):
        expect(second.get_by_label(label)).to_be_disabled()
    expect(second.get_by_label("Target force, N (empty: a gentle squeeze)")).to_have_value("2")
    second.keyboard.type("B2")
    second.keyboard.press("F8")
    expect(driver.get_by_label(ITEM)).to_have_value("")
    driver.get_by_label("Target force, N (empty: a gentle squeeze)").fill("")
    expect_enabled(driver, "#grasp")
    driver.locator("#grasp").click()
    second.wait_for_function(CLOSES)
    second.locator("#stop").click()
    for page in (driver, second):
        expect_verdict(page, "stopped on request")
    second.locator("#take-over").click()
    expect(second.locator("#who")).to_contain_text("you drive")
    expect(driver.locator("#who")).to_have_text("you watch")
    expect(driver.get_by_text("Another user is now the driver")).to_be_visible()
    expect(driver.locator("#release")).to_be_disabled()
    release(second)


#: Delays every response by 0.6 s.
_DELAY_FETCH = """() => {
    const fetched = window.fetch;
    window.fetch = async (...asked) => {
        const reply = await fetched(...asked);
        await new Promise((done) => setTimeout(done, 600));
        return reply;
    };
}"""


def test_age_of_the_last_frame_includes_the_network_delay(driver: Page) -> None:
    age = re.compile(r"last frame ([6-9]\d\d ms|\d+\.\d s) ago")
    driver.evaluate(_DELAY_FETCH)
    expect(driver.locator("#link-age")).to_have_text(age)
    drawn = driver.evaluate("+document.body.dataset.drawn")
    driver.wait_for_function("(before) => +document.body.dataset.drawn > before + 2", arg=drawn)
    assert age.fullmatch(driver.locator("#link-age").inner_text().strip("· "))


def test_rest_calibration_shows_the_guide_and_the_result(driver: Page, folder: Path) -> None:
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


@pytest.mark.parametrize("preferred", ["light", "dark"])
def test_page_switches_between_light_and_dark(
    open_page: Callable[..., Page], preferred: str
) -> None:
    page = open_page(color_scheme=preferred)
    expect_fresh_link(page)
    opposite = {"light": "dark", "dark": "light"}[preferred]
    for expected in (opposite, preferred):
        page.locator("#shade").click()
        expect(page.locator("body")).to_have_class(re.compile(f"body--{expected}"))


def test_doctor_tab_shows_the_health_of_the_sensor(driver: Page) -> None:
    open_tab(driver, "Doctor")
    expect_enabled(driver, "#examine")
    driver.locator("#examine").click()
    expect(driver.locator("#health")).to_contain_text("frames in 10")
    maps = driver.locator("#health .heat")
    expect(maps).to_have_count(3)
    expect(maps.first.locator("td[title]")).to_have_count(8)


def test_recording_can_be_replayed_and_closed(driver: Page, folder: Path) -> None:
    grasp(driver)
    release(driver)
    newest = max((folder / "data").glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    open_tab(driver, "Recordings")
    driver.get_by_label("Replay speed").get_by_role("button", name="10×").click()
    name = driver.get_by_text(newest.stem, exact=True)
    row = driver.locator("#recordings .file").filter(has=name)
    row.get_by_role("button", name="Replay").click()
    expect(driver.locator("#rig-name")).to_contain_text(f"replay of {newest.name}")
    expect(driver.locator("#link-text")).to_have_text("replay")
    expect_verdict(driver, "held and released")
    driver.get_by_role("button", name="Back to the rig").click()
    expect(driver.locator("#rig-name")).to_have_text("sim-rigid")
    expect_fresh_link(driver)


def test_new_recording_in_the_list_keeps_existing_buttons_in_place(
    driver: Page, folder: Path
) -> None:
    old, new = (folder / "data" / name for name in ("old.mcap", "new.mcap"))
    old.parent.mkdir(exist_ok=True)
    old.write_bytes(b"started")
    open_tab(driver, "Recordings")
    rows = driver.locator("#recordings .file")
    button = rows.filter(has_text="old").get_by_role("button", name="Replay").element_handle()
    old.write_bytes(b"and ended" * 1000)
    new.write_bytes(b"another")
    expect(rows.filter(has_text="new")).to_be_visible()
    expect(rows.filter(has_text="old")).to_contain_text("9 kB")
    assert button.evaluate("button => button.isConnected")
    for file in (old, new):
        file.unlink()
    expect(rows.filter(has_text="new")).to_have_count(0)


def test_grasp_of_a_named_item_appears_in_its_history(driver: Page) -> None:
    driver.get_by_label(ITEM).fill("berry-7")
    for again in (False, True):
        if again:
            # A grasp clears the name.
            driver.locator("#same-item").click()
        grasp(driver)
        release(driver)
    open_tab(driver, "Items")
    # The input receives no pointer events; users press the surrounding field.
    driver.locator("label").filter(has=driver.get_by_label("Item", exact=True)).click()
    driver.get_by_role("option", name="berry-7").click()
    page = driver.locator("#item-page")
    expect(page).to_contain_text("2 grasps")
    expect(page).to_contain_text("SIMULATED")
    expect(page.get_by_role("img", name="Settled change over time")).to_be_visible()


def test_browser_back_shows_the_previous_tab_and_reload_keeps_the_driver(driver: Page) -> None:
    for name in ("Calibrate", "Doctor"):
        open_tab(driver, name)
        expect(driver.get_by_role("tab", name=name)).to_have_attribute("aria-selected", "true")
    driver.wait_for_url("**/doctor")
    driver.evaluate("window.same = true")
    for name, path in (("Calibrate", "/calibrate"), ("Set up", "/")):
        driver.go_back()
        expect(driver.get_by_role("tab", name=name)).to_have_attribute("aria-selected", "true")
        assert driver.evaluate("location.pathname") == path
    assert driver.evaluate("window.same"), "the page must not be reloaded"
    expect(driver.locator("#who")).to_have_text("you drive")
    driver.reload()
    expect_fresh_link(driver)
    expect(driver.locator("#who")).to_have_text("you drive")


#: Overlap of the object's text with the pads, pixels.
OVERLAP_WITH_PADS = """() => {
    const boxes = (what) => [...document.querySelectorAll(`#fingers ${what}`)]
        .map((one) => one.getBoundingClientRect());
    return boxes('.thing').flatMap((words) => boxes('.sheet').map((pad) =>
        Math.min(words.right, pad.right) - Math.max(words.left, pad.left)));
}"""


@pytest.mark.parametrize("width", [320, 390, 1024])
def test_soft_gripper_page_shows_the_held_object_and_fits_the_screen(
    open_page: Callable[..., Page], tmp_path: Path, width: int
) -> None:
    rig = ("--rig", "sim-soft", *STRAWBERRY, "--speed", "10", "--rate-hz", "15")
    with serve_dashboard(tmp_path, *rig) as address:
        page = open_page(address, viewport={"width": width, "height": 768})
        expect_fresh_link(page)
        # No previous grasp is shown, and without a load cell the force can't be calibrated.
        open_tab(page, "Calibrate")
        expect(page.locator("#calibrate-rest")).to_be_visible()
        expect(page.locator("#calibrate-force")).to_be_hidden()
        grasp(page)
        expect(page.locator("#fingers .thing")).not_to_have_count(0)
        expect(page.locator("#fingers .thing").first).to_have_text(re.compile("held|mm"))
        expect(page.locator("#fingers .centre:not(.hidden)")).to_have_count(2)
        assert max(page.evaluate(OVERLAP_WITH_PADS)) <= 0
        for name in ("Set up", "Calibrate", "Recordings", "Items", "Run"):
            open_tab(page, name)
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
    drive(page)
    expect_enabled(page, "#grasp")
    reached: set[str] = set()
    for _ in range(40):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.innerText"))
    assert {"grasp", "release", "stop", "use-rig", "shade"} <= reached
    assert page.evaluate("document.body.classList.contains('body--dark')")


#: Delays every response by 1.5 s with the page's own timers.
_DELAY_RESPONSES = """() => {
    const asked = window.fetch;
    window.fetch = (...what) => new Promise((answer, refuse) => {
        what[1]?.signal?.addEventListener('abort', () => refuse(what[1].signal.reason));
        asked(...what).then((reply) => setTimeout(answer, 1500, reply), refuse);
    });
}"""


def test_slow_connection_is_reported_and_the_page_is_still_updated(
    open_page: Callable[..., Page],
) -> None:
    page = open_page()
    expect_fresh_link(page)
    page.evaluate(_DELAY_RESPONSES)
    expect(page.locator("#lost-title")).to_have_text("No connection")
    drawn = page.evaluate("Number(document.body.dataset.drawn)")
    page.wait_for_function("(drawn) => document.body.dataset.drawn > drawn + 1", arg=drawn)
    expect(page.locator("#lost")).to_be_visible()


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


def test_missing_response_does_not_delay_later_requests(open_page: Callable[..., Page]) -> None:
    page = open_page()
    expect_fresh_link(page)
    assert page.evaluate(_LOSE_ONE_RESPONSE)


def test_page_with_a_damage_file_has_a_choice_of_the_kind(
    open_page: Callable[..., Page], tmp_path: Path
) -> None:
    damage = write_damage_file(tmp_path)
    with serve_dashboard(tmp_path, *SIMULATED, "--damage", str(damage)) as address:
        page = open_page(address)
        expect_fresh_link(page)
        page.get_by_label("Kind (for its damage limit)").click()
        page.get_by_role("option", name="kiwi").click()
        page.get_by_label("Target force, N (empty: a gentle squeeze)").fill("8")
        grasp(page)
        expect(page.locator("#verdict")).to_contain_text("limited by the damage limit")
        release(page)
    (recording,) = (tmp_path / "data").glob("grasp-*.mcap")
    info = load_recording(recording).info
    assert (info.kind, info.damage) == ("kiwi", damage.read_text())


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


def test_stop_is_confirmed_after_startup_and_a_killed_server_leaves_no_process(
    tmp_path: Path,
) -> None:
    with run_server(tmp_path, *SIMULATED) as (address, process):
        with urllib.request.urlopen(f"{address}stop", data=b"", timeout=30) as reply:
            assert json.load(reply) == {"stopped": True}
        children = children_of(process.pid)
        assert children
        process.kill()
        process.wait()
        deadline = monotonic() + 30.0
        while filter_running(children) and monotonic() < deadline:
            os.sched_yield()
        assert not filter_running(children)


def filter_running(pids: list[int]) -> list[int]:
    """Return the running processes, without zombies."""
    states = {pid: Path(f"/proc/{pid}/stat") for pid in pids}
    return [pid for pid, stat in states.items() if stat.exists() and " Z " not in stat.read_text()]
