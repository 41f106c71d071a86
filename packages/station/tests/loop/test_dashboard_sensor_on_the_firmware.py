"""A sensor without a gripper, from `palpate init` to the page, through the real firmware.

The firmware runs on the AVR simulator in real time, behind a pseudo-terminal that `palpate serve`
opens as a board's port. The pads are pressed in the twin.
"""

from __future__ import annotations

import os
import re
import threading
import tty
from collections.abc import Iterator
from contextlib import suppress
from time import monotonic

import numpy as np
import pytest
from packages.station.tests.served_pages import (
    PHONE,
    expect_fresh_link,
    expect_verdict,
    open_tab,
    serve_dashboard,
    visit,
)
from playwright.sync_api import Browser, Page, expect

from palpate.cli import build_app, run
from palpate.clock import ManualClock
from palpate.gripper.interface import GripperCommand
from palpate.sensor.array import RIGID_LAYOUT
from palpate.twin.devices import TwinGripper
from palpate.twin.firmware import FirmwareBoard
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World

pytestmark = pytest.mark.usefixtures("firmware_built")

#: Seed of the sheet and its calibration; the ball was not used for the calibration.
SHEET, BALL = 3, "ball-44lbs"
STEP_S = 0.004


class PressedBoard:
    """A board on a serial line, and a ball that can press on its pads."""

    def __init__(self) -> None:
        self._ball = draw_object(np.random.default_rng(SHEET), BALL)
        self._clock = ManualClock()
        self._world = World(self._ball, seed=5, sheet_seed=SHEET, clock=self._clock)
        self._board = FirmwareBoard(seed=1)
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self.force_n = 0.0
        self.press, self._ended = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)
        self._board.close()

    def _run(self) -> None:
        hand, began_s, pressed = TwinGripper(self._world), monotonic(), False
        while not self._ended.wait(STEP_S):
            # On a slow machine the board runs slower, so that no step exceeds the line's buffer.
            now_s = min(monotonic() - began_s, self._clock.now_s() + 0.1)
            began_s = monotonic() - now_s
            if self.press.is_set() and not pressed:
                hand.command(GripperCommand(target=self._ball.size_mm - 3.0, rate=40.0))
                pressed = True
            self._clock.sleep_s(now_s - self._clock.now_s())
            self._board.set_pixels_mv(1e3 * self._world.pixel_voltage_v(now_s))
            self.force_n = self._world.force_n(now_s)
            with suppress(BlockingIOError):
                self._board.write_bytes(os.read(self._master, 4096))
            self._board.run_until(now_s)
            with suppress(
                BlockingIOError
            ):  # without a reader the bytes are lost, as on a real port
                os.write(self._master, self._board.read_bytes())


@pytest.fixture(scope="module")
def board(firmware_built: None) -> Iterator[PressedBoard]:
    board = PressedBoard()
    yield board
    board.close()


@pytest.fixture(scope="module")
def address(board: PressedBoard, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("sensor")
    rig = folder / "rig.toml"
    arguments = ["init", str(rig), "--port", board.port, "--layout", RIGID_LAYOUT.name]
    arguments += ["--gripper", "none", "--rate-hz", "100", *divider_options()]
    assert run(build_app(), arguments, name="palpate") == 0
    calibrate_twin(seed=SHEET, level="lab", apart_from=BALL).save(folder / "rig-calibration.json")
    with serve_dashboard(folder, "--rig", str(rig)) as address:
        yield address


def divider_options() -> tuple[str, ...]:
    """Return the options that describe the twin's divider."""
    divider = RIGID_LAYOUT.divider
    leg, ohm = divider.taxel_leg, f"{divider.reference_ohm:g}"
    return "--taxel-leg", leg, "--reference-ohm", ohm, "--idle-lines", RIGID_LAYOUT.idle_lines


@pytest.fixture(scope="module")
def page(browser: Browser, address: str) -> Iterator[Page]:
    with visit(browser, address) as page:
        expect_fresh_link(page)
        yield page


#: Whether the shown force is within 30 % of a force, newtons, and its interval contains the force.
SHOWS_FORCE = """(force) => {
    const [value, low, high] = document.getElementById('force-at').textContent.match(/[\\d.]+/g);
    return low < force && force < high && Math.abs(value / force - 1) < 0.3;
}"""


def test_sensor_page_on_the_firmware_shows_pixels_and_forces_but_no_grasp(page: Page) -> None:
    expect_verdict(page, "watching")
    expect(page.locator("#simulated")).to_be_hidden()
    expect(page.locator("#fingers-title")).to_have_text("2 pads")
    pixels = page.locator(".pixel")
    expect(pixels).to_have_count(8)
    boxes = [pixels.nth(number).bounding_box() for number in range(8)]
    sides = {round(box[side]) for box in boxes for side in ("width", "height")}
    assert len(sides) == 1, "the pitch is equal along x and y"
    # R0 C0, R0 C1, R1 C0, R1 C1 of finger 0, then of finger 1 to its right.
    places = [(box["x"], box["y"]) for box in boxes]
    assert places[0][0] < places[1][0] < places[4][0]
    assert places[0][1] == places[1][1] < places[2][1]
    expect(page.locator("#force-card")).to_be_visible()
    for element in ("#grasp", "#release", "#measure-size_mm"):
        expect(page.locator(element)).to_be_hidden()
    # The page shows no grip, no forecast and no finger movements.
    expect(page.locator("#force-title")).to_have_text("Force, N")
    expect(page.locator("#measure-force_n .name")).to_have_text("Force now")
    expect(page.locator("#pad-1 .name")).to_have_text(re.compile("^pad 2"))
    for key in page.locator(".key.of-hand").all():
        expect(key).to_be_hidden()
    # The force card uses the whole row.
    boxes = [page.locator(one).bounding_box() for one in ("#measure-force_n", "#verdict")]
    assert len({box and (box["x"], box["width"]) for box in boxes}) == 1
    expect(page.get_by_label("Target force")).to_be_hidden()
    expect(page.get_by_label("Rig", exact=True)).to_be_visible()
    page.locator("#stop").click()
    expect(page.locator("#stop")).to_have_attribute("data-state", "confirmed")


def test_sensor_page_on_the_firmware_shows_the_force_of_a_press(
    page: Page, board: PressedBoard
) -> None:
    page.wait_for_function("parseFloat(document.getElementById('force-at').textContent) < 1")
    board.press.set()
    expect(page.locator("#pad-0")).to_have_class(re.compile("touching"))
    page.wait_for_function("parseFloat(document.getElementById('force-at').textContent) > 1")
    assert board.force_n > 1.0
    page.wait_for_function(SHOWS_FORCE, arg=board.force_n)


def test_operator_page_without_a_gripper_shows_the_force_and_no_grasp_buttons(
    browser: Browser, address: str
) -> None:
    with visit(browser, f"{address}operate", viewport=PHONE) as page:
        expect_verdict(page, "Contact")
        expect(page.locator("#force-now")).to_have_text(re.compile(r"^[1-9]\d*\.\d$"))
        for element in ("#grasp", "#release", ".item"):
            expect(page.locator(element)).to_be_hidden()
        boxes = [page.locator(one).bounding_box() for one in ("#stop", "#verdict")]
        assert len({(box["x"], box["width"]) for box in boxes}) == 1


def test_doctor_tab_examines_the_firmware_at_its_configured_rate(
    page: Page, board: PressedBoard
) -> None:
    open_tab(page, "Doctor")
    page.locator("#examine").click()
    expect(page.locator("#health")).to_contain_text("frames in 10")
    expect(page.locator("#health")).to_contain_text("0 corrupt")
