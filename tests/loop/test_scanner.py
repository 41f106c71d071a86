"""Barcode scanner on the operator's page: item names arrive as key presses."""

from __future__ import annotations

from pathlib import Path

from playwright.sync_api import Browser, expect
from tests.loop.test_dashboard import (
    STRAWBERRY,
    TIMEOUT_MS,
    browser,
    drive,
    expect_enabled,
    expect_fresh_link,
    serve_dashboard,
)
from tests.loop.test_dashboard_api import Machine

__all__ = ["browser"]

FAST = ("--rig", "sim-rigid", *STRAWBERRY, "--speed", "20", "--rate-hz", "15")
SCANS = 20


def test_twenty_scanned_items_are_each_stored_with_their_own_name(
    browser: Browser, tmp_path: Path
) -> None:
    with serve_dashboard(tmp_path, *FAST) as address:
        machine = Machine(address)
        page = browser.new_context(viewport={"width": 800, "height": 480}).new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.goto(f"{address}operate")
        expect_fresh_link(page)
        drive(page)
        field = page.get_by_label("Next item")
        for number in range(SCANS):
            # The next scan replaces the wrong first scan.
            for name in ("wrong", f"A-{number}"):
                page.keyboard.type(name)
                page.keyboard.press("Enter")
                expect(field).to_have_value(name)
                expect(page.locator(".taken")).to_be_visible()
            expect_enabled(page, "#grasp")
            page.keyboard.press("F8")
            machine.until(lambda at: at["phase"] is not None)
            # The grasp clears the name.
            expect(field).to_have_value("")
            expect(page.locator(".taken")).to_have_count(0)
            page.keyboard.press("Escape")
            machine.until(lambda at: at["activity"] == "watching")
            assert machine.ask("GET", "/result")[1]["item_id"] == f"A-{number}"
            # A page that has not seen the stop yet would have its release refused.
            expect(page.locator("#next-text")).to_contain_text("Press Release")
            page.keyboard.press("F9")
            machine.ready()
        names = [item["item_id"] for item in machine.ask("GET", "/items")[1]["items"]]
        assert sorted(names) == sorted(f"A-{number}" for number in range(SCANS))
        again = page.locator("#same-item")
        expect(again).to_have_text(f"Same item again: A-{SCANS - 1}")
        again.focus()
        page.keyboard.press("Enter")
        expect(field).to_have_value(f"A-{SCANS - 1}")
        page.context.close()
