"""Barcode scanner on the operator's page: item names arrive as key presses."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from packages.station.tests.served_pages import (
    Machine,
    expect_enabled,
    serve_dashboard,
    visit_as_driver,
)
from playwright.sync_api import Browser, expect

PANEL = {"viewport": {"width": 800, "height": 480}}
SCANS = 3
RULES = """default = "by hand"
confidence = 0.9
most_grasps = 2
[[rule]]
bin = "soft"
firmness = [0, 63]
[[rule]]
bin = "firm"
firmness = [63, 100]
"""
#: Measured firmness close to the limit of the rules.
AVOCADO = ("--rig", "sim-rigid", "--object", "avocado-day-3", "--speed", "10", "--rate-hz", "15")


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    (folder / "rules.toml").write_text(RULES)
    with serve_dashboard(folder, *AVOCADO, "--rules", str(folder / "rules.toml")) as address:
        yield address


def test_scanned_items_are_each_stored_with_their_own_name(browser: Browser, address: str) -> None:
    machine = Machine(address)
    with visit_as_driver(browser, f"{address}operate", **PANEL) as page:
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
            # A hand that has not moved yet needs no release after the stop.
            machine.until(lambda at: at["phase"] is not None and at["hand_open"] is False)
            # The grasp takes the name, and the stop returns it, as the item was not measured.
            expect(field).to_have_value("")
            expect(page.locator(".taken")).to_have_count(0)
            page.keyboard.press("Escape")
            expect(field).to_have_value(f"A-{number}")
            machine.until(lambda at: at["activity"] == "watching")
            assert machine.ask("GET", "/result")[1]["item_id"] == f"A-{number}"
            # A page that has not seen the stop yet would have its release refused.
            expect(page.locator("#next-text")).to_contain_text("Press Release")
            page.keyboard.press("F9")
            machine.ready()
        names = [item["item_id"] for item in machine.ask("GET", "/items")[1]["items"]]
        assert sorted(names) == sorted(f"A-{number}" for number in range(SCANS))
        page.get_by_label("Clear").click()
        again = page.locator("#same-item")
        expect(again).to_be_visible()
        expect(again).to_have_text(f"Same item again: A-{SCANS - 1}")
        again.focus()
        page.keyboard.press("Enter")
        expect(field).to_have_value(f"A-{SCANS - 1}")


def test_obedient_operator_grasps_an_item_under_its_name_until_its_bin_is_final(
    browser: Browser, address: str
) -> None:
    machine = Machine(address)
    with visit_as_driver(browser, f"{address}operate", **PANEL) as page:
        field = page.locator("input.scanned")
        expect(field).to_be_enabled()
        # A damaged label is red and can't be grasped.
        page.keyboard.type("4006381333932")
        page.keyboard.press("Enter")
        expect(page.locator(".refused")).to_be_visible()
        expect(page.locator(".taken")).to_have_count(0)
        expect(page.locator(".q-notification")).to_contain_text("wrong check digit")
        page.keyboard.press("F8")
        assert machine.ask("GET", "/state")[1]["activity"] == "watching"
        page.keyboard.type("K1")
        page.keyboard.press("Enter")
        expect(page.locator(".taken")).to_be_visible()
        for name, again in (("K1", True), ("K1", False), (None, False)):
            expect_enabled(page, "#grasp")
            page.keyboard.press("F8")
            machine.until(lambda at: at["answered"])
            expect(field).to_have_value("K1" if again else "")
            why = "K1" if name else "not stored: no item"
            expect(page.locator("#verdict-why")).to_contain_text(why)
            page.keyboard.press("F9")
            machine.ready()
            result = machine.ask("GET", "/result")[1]
            assert result.get("item_id") == name
            assert result["bin"]["again"] == again
            assert (result["stored"], result["not_stored"]) == (
                (True, None) if name else (False, "no item")
            )
