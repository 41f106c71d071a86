"""Sound of the operator's page."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser, Page, expect
from tests.loop.test_dashboard import (
    SIMULATED,
    browser,
    expect_enabled,
    expect_fresh_link,
    expect_verdict,
    release,
    serve_dashboard,
)
from tests.loop.test_operator_view import SIZES, at

__all__ = ["browser"]

#: Records the pitch of every tone that the browser plays.
LISTEN = """window.heard = [];
const start = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (when) {
    if (this.context.state === 'running') window.heard.push(this.frequency.value);
    return start.call(this, when);
};"""
DONE_HZ, FAULT_HZ = 880, 220


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with serve_dashboard(tmp_path_factory.mktemp("sound"), *SIMULATED) as address:
        yield address


def expect_tones(page: Page, tones: list[int]) -> None:
    page.wait_for_function("count => window.heard.length >= count", arg=len(tones))
    assert page.evaluate("window.heard") == tones


def test_sound_is_off_by_default_and_differs_for_done_and_fault(
    browser: Browser, address: str
) -> None:
    with at(browser, f"{address}operate", SIZES["wide"]) as page:
        page.add_init_script(LISTEN)
        page.reload()
        expect_fresh_link(page)
        expect_enabled(page, "#grasp")
        page.locator("#grasp").click()
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "good")
        release(page)
        expect_tones(page, [])
        button = page.get_by_role("button", name="Sound")
        expect(button).to_have_attribute("aria-pressed", "false")
        button.click()
        expect(button).to_have_attribute("aria-pressed", "true")
        # Enabling the sound plays a tone to demonstrate its volume.
        expect_tones(page, [DONE_HZ])
        # The browser stores the setting and may play sound after a user interaction.
        page.reload()
        expect_fresh_link(page)
        expect(button).to_have_attribute("aria-pressed", "true")
        expect_enabled(page, "#grasp")
        page.locator("#grasp").click()
        expect_tones(page, [DONE_HZ])
        page.locator("#stop").click()
        expect_verdict(page, "Stopped")
        expect_tones(page, [DONE_HZ, FAULT_HZ])
        release(page)
        button.click()
        expect(button).to_have_attribute("aria-pressed", "false")


def test_loss_of_the_server_plays_the_fault_tone(browser: Browser, address: str) -> None:
    with at(browser, f"{address}operate", SIZES["wide"]) as page:
        page.add_init_script(LISTEN)
        page.reload()
        expect_fresh_link(page)
        page.get_by_role("button", name="Sound").click()
        expect_tones(page, [DONE_HZ])
        page.context.set_offline(True)
        expect(page.locator("#lost-title")).to_have_text("No connection")
        expect_tones(page, [DONE_HZ, FAULT_HZ])
