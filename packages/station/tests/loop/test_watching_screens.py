"""Screens that only watch, and notifications that end with their reason."""

from __future__ import annotations

from pathlib import Path

import pytest
from packages.station.tests.served_pages import (
    SIMULATED,
    TARGET,
    Machine,
    serve_dashboard,
    visit,
    visit_as_driver,
    write_users,
)
from playwright.sync_api import Browser, expect

#: A notification without a state of its own stays for 5 s.
SOON_MS = 3000
#: Minimum font size for reading from two metres, px.
NEXT_PX = 20
FONT_PX = "parseFloat(getComputedStyle(document.getElementById('next-text')).fontSize)"


def test_user_who_may_only_watch_is_never_asked_to_press(browser: Browser, tmp_path: Path) -> None:
    with serve_dashboard(tmp_path, *SIMULATED, *write_users(tmp_path)) as address:
        maria = Machine(address, "marias-token")
        maria.ready()
        with visit(browser, f"{address}operate?token=screens-token") as page:
            step = page.locator("#next-text")
            expect(step).to_have_text("This screen only watches")
            assert page.evaluate(FONT_PX) >= NEXT_PX
            expect(page.locator("#take-over")).to_be_hidden()
            expect(page.locator("#who")).to_have_text("screen · you only watch")
            expect(page.locator("#guard")).to_contain_text("Ready · force limit 15 N, checked 15")
            expect(page.locator("#grasp")).to_be_disabled()
            assert maria.ask("POST", "/grasp", {})[0] == 202
            expect(step).to_have_text("Another screen controls (maria)")
            assert page.evaluate(FONT_PX) >= NEXT_PX
            maria.until(lambda at: at["state"] == "holding")
            expect(page.locator("#guard")).to_contain_text("Busy: grasping")
            expect(page.locator("#opens")).not_to_be_empty()
            assert "press" not in page.locator("#next-step").inner_text().lower()
            maria.ask("POST", "/release")
            # At the change of a shift, the next person logs in.
            page.locator("#logout").click()
            page.locator("input[name=token]").fill("marias-token")
            page.keyboard.press("Enter")
            expect(page.locator("#who")).to_contain_text("maria · ")


@pytest.mark.parametrize(
    ("path", "label", "wrong", "right", "reason"),
    [
        ("", TARGET, "99", "2", "must be at least 0.15 N"),
        ("operate", "", "4006381333932", "4006381333931", "wrong check digit"),
    ],
)
def test_notification_ends_with_its_reason(
    browser: Browser, address: str, path: str, label: str, wrong: str, right: str, reason: str
) -> None:
    with visit_as_driver(browser, f"{address}{path}") as page:
        field = page.get_by_label(label) if label else page.locator("input.scanned")
        note = page.locator(".q-notification")
        field.fill(wrong)
        if label:
            page.locator("#grasp").click()
        else:
            field.press("Enter")
        expect(note).to_contain_text(reason)
        field.fill(right)
        expect(note).to_have_count(0, timeout=SOON_MS)
        field.fill("")


def test_notification_of_a_lost_control_ends_when_nobody_controls(
    browser: Browser, address: str
) -> None:
    machine = Machine(address)
    with visit_as_driver(browser, f"{address}operate") as page:
        note = page.locator(".q-notification")
        machine.ask("PUT", "/driver")
        expect(note).to_contain_text("Another screen controls now")
        machine.ask("DELETE", "/driver")
        expect(note).to_have_count(0, timeout=SOON_MS)
