"""A sensor without a gripper on the page: pads, pixel details, rest and STOP."""

from __future__ import annotations

import os
import re
import threading
import tty
from collections.abc import Iterator

import pytest
from benchmarks.dashboard import ROOT
from playwright.sync_api import Browser, Page, expect
from tests.loop.test_dashboard import (
    TIMEOUT_MS,
    WIDE,
    browser,
    expect_fresh_link,
    expect_verdict,
    open_tab,
    run_until_unplugged,
    serve_dashboard,
)

from palpate.cli import build_app, run

__all__ = ["browser"]


@pytest.fixture(scope="module")
def page(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A board on a serial line, described by `palpate init --gripper none`."""
    folder = tmp_path_factory.mktemp("sensor")
    master, slave = os.openpty()
    tty.setraw(slave)
    plugged = threading.Thread(target=run_until_unplugged, args=(master,), daemon=True)
    plugged.start()
    port = folder / "board"
    port.symlink_to(os.ttyname(slave))
    rig = folder / "rig.toml"
    arguments = [
        "init",
        str(rig),
        "--port",
        str(port),
        "--layout",
        "rigid-2x2",
        "--gripper",
        "none",
    ]
    arguments += ["--reference-ohm", "4700", "--taxel-leg", "upper", "--idle-lines", "isolated"]
    assert run(build_app(), [*arguments, "--rate-hz", "100"], name="palpate") == 0
    with serve_dashboard(folder, "--rig", str(rig), PYTHONPATH=str(ROOT)) as address:
        context = browser.new_context(viewport=WIDE)
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(address)
        expect_fresh_link(page)
        yield page
        context.close()
    os.close(slave)
    os.close(master)
    plugged.join(10)


def test_sensor_page_shows_readings_and_offers_no_grasp(page: Page) -> None:
    expect_verdict(page, "watching")
    expect(page.locator("#simulated")).to_be_hidden()
    expect(page.locator("#grasp")).to_be_hidden()
    expect(page.locator("#release")).to_be_hidden()
    expect(page.locator("#fingers-title")).to_have_text("2 pads")
    expect(page.locator("#measure-size_mm")).to_be_hidden()
    expect(page.locator("#force-card")).to_be_hidden()


def test_sensor_page_draws_square_pixels_in_their_rows(page: Page) -> None:
    pixels = page.locator(".pixel")
    expect(pixels).to_have_count(8)
    boxes = [pixels.nth(i).bounding_box() for i in range(8)]
    assert all(box is not None for box in boxes)
    sides = {round(box[side]) for box in boxes if box for side in ("width", "height")}
    assert len(sides) == 1, "the pitch is equal along x and y"
    places = [(box["x"], box["y"]) for box in boxes if box]
    # R0 C0, R0 C1, R1 C0, R1 C1 of finger 0, then of finger 1 to its right.
    assert places[0][0] < places[1][0] < places[4][0]
    assert places[0][1] == places[1][1] < places[2][1]


def test_sensor_page_shows_pixel_details_after_tap_and_arrow_keys(page: Page) -> None:
    near = page.locator("#pixel")
    expect(near).to_be_hidden()
    page.locator(".cell[data-row='2'][data-col='1']").click()
    expect(page.locator("#pixel-name")).to_have_text("R2 C1")
    expect(page.locator("#pixel-ohm")).to_have_text(re.compile(r"^[\d,]+ ohm$"))
    expect(page.locator("#pixel-range")).to_have_text(
        re.compile(r"last 30 s: [\d,]+ to [\d,]+ ohm")
    )
    expect(page.locator("#pixels")).to_have_attribute("data-count", "8")
    page.locator("#fingers").focus()
    page.keyboard.press("ArrowUp")
    expect(page.locator("#pixel-name")).to_have_text("R1 C1")
    page.get_by_role("button", name="Close").click()
    expect(near).to_be_hidden()


def test_sensor_page_rest_calibration_requires_still_readings(page: Page) -> None:
    open_tab(page, "Calibrate")
    page.locator("#calibrate-rest").click()
    # The simulated board's readings drift, so they are not at rest.
    expect(page.locator("#trouble-text")).to_contain_text("% at rest (at most")
    expect_verdict(page, "calibration failed")
    expect(page.locator("#calibrated .result")).to_have_text("Calibration failed")
    expect(page.locator("#calibrated .finding")).to_contain_text("% at rest (at most")
    expect(page.locator("#calibrated")).to_contain_text("Last step: Do not touch the sensor")


def test_sensor_page_stop_is_confirmed_without_a_hand(page: Page) -> None:
    page.locator("#stop").click()
    expect(page.locator("#stop")).to_have_attribute("data-state", "confirmed")
