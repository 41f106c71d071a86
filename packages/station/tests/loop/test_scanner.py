"""Barcode scanner on the operator's page: item names arrive as key presses."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from packages.station.tests.served_pages import (
    Machine,
    expect_enabled,
    serve_dashboard,
    visit,
    visit_as_driver,
)
from playwright.sync_api import Browser, expect

PANEL = {"viewport": {"width": 800, "height": 480}}
SCANS = 3
RULES = """default = "by hand"
confidence = 0.999
most_grasps = 2
[[rule]]
bin = "soft"
firmness = [0, 63]
[[rule]]
bin = "firm"
firmness = [63, 100]
"""
BIN = re.compile("^(soft|firm|by hand)$", re.IGNORECASE)
#: Measured firmness close to the limit of the rules, whose certainty no single grasp reaches.
AVOCADO = ("--rig", "sim-rigid", "--object", "avocado-day-3", "--speed", "10", "--rate-hz", "15")


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    (folder / "rules.toml").write_text(RULES)
    with serve_dashboard(folder, *AVOCADO, "--rules", str(folder / "rules.toml")) as address:
        yield address


def test_scanned_items_are_each_stored_with_their_own_name(browser: Browser, address: str) -> None:
    machine = Machine(address)
    with visit_as_driver(browser, f"{address}operate", **PANEL) as page:
        field = page.locator("input.scanned")
        for number in range(SCANS):
            # The last item was stopped: the second scan of the next one ends it as it is.
            for _ in range(2 if number else 1):
                page.keyboard.type(f"A-{number}")
                page.keyboard.press("Enter")
                expect(field).to_have_value(f"A-{number}")
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
            expect(page.locator("#next-text")).to_contain_text("ress Release")
            page.keyboard.press("F9")
            machine.ready()
        names = [item["item_id"] for item in machine.ask("GET", "/items")[1]["items"]]
        assert sorted(names) == sorted(f"A-{number}" for number in range(SCANS))
        page.get_by_label("Clear").click()
        again = page.locator("#same-item")
        expect(again).to_be_visible()
        expect(again).to_have_text(f"Again: A-{SCANS - 1}")
        again.focus()
        page.keyboard.press("Enter")
        expect(field).to_have_value(f"A-{SCANS - 1}")
        page.get_by_label("Clear").click()
        expect(field).to_have_value("")


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
            expect(page.locator("#verdict-item")).to_have_text(name or "")
            expect(page.locator("#badge")).to_have_text("" if name else "NOT STORED: no name")
            page.keyboard.press("F9")
            machine.ready()
            result = machine.ask("GET", "/result")[1]
            assert result.get("item_id") == name
            assert result["bin"]["again"] == again
            assert (result["stored"], result["not_stored"]) == (
                (True, None) if name else (False, "no item")
            )


def test_scans_of_a_held_and_of_a_sorted_item_are_not_taken_at_once(
    browser: Browser, tmp_path: Path
) -> None:
    (tmp_path / "rules.toml").write_text(RULES)
    with (
        serve_dashboard(tmp_path, *AVOCADO, "--rules", str(tmp_path / "rules.toml")) as address,
        visit_as_driver(browser, f"{address}operate", **PANEL) as page,
    ):
        machine, field = Machine(address), page.locator("input.scanned")

        def scan(name: str) -> None:
            page.keyboard.type(name)
            page.keyboard.press("Enter")

        def grasp() -> None:
            expect_enabled(page, "#grasp")
            page.keyboard.press("F8")
            machine.until(lambda at: at["answered"])

        expect(field).to_be_enabled()
        scan("K1")
        expect(page.locator(".taken")).to_be_visible()
        grasp()
        expect(field).to_have_value("K1")
        # The next item, although this one has to be turned.
        scan("K2")
        expect(page.locator(".refused")).to_be_visible()
        expect(page.locator("#next-text")).to_contain_text("K1 is not finished")
        page.keyboard.press("F9")
        machine.ready()
        # No grasp begins before it is clear which item is in the gripper.
        expect(page.locator("#next-text")).to_contain_text("K1 is not finished")
        expect(page.locator("#grasp.blocked")).to_be_visible()
        page.keyboard.press("F8")
        expect(page.locator(".q-notification")).to_contain_text("K1 is not finished")
        assert machine.ask("GET", "/state")[1]["activity"] == "watching"
        scan("K1")
        expect(page.locator(".taken")).to_be_visible()
        expect(page.locator("#grasp.blocked")).to_have_count(0)
        grasp()
        expect(field).to_have_value("")
        page.keyboard.press("F9")
        machine.ready()
        assert machine.ask("GET", "/result")[1]["item_id"] == "K1"
        expect(page.locator("#lot")).to_contain_text("items 1")
        expect(page.locator("#verdict-why")).to_contain_text("stored")
        # A person corrects the bin.
        shown = page.locator("#verdict-text").inner_text().lower()
        right = next(name for name in ("soft", "firm") if name != shown)
        page.locator("#wrong-bin").click()
        page.get_by_label("Your name").fill("maria")
        page.get_by_role("button", name=right).click()
        expect(page.locator("#verdict-text")).to_have_text(re.compile(right, re.IGNORECASE))
        expect(page.locator("#lot")).to_contain_text(f"{right} 1")
        given = machine.ask("GET", "/items/K1")[1]["verdicts"][-1]
        assert (given["text"], given["source"], given["details"]) == (
            *(right, "person"),
            {"by": "maria"},
        )
        scan("K1")
        expect(page.locator(".refused")).to_be_visible()
        expect(page.locator("#next-text")).to_contain_text("K1 was already sorted")
        page.keyboard.press("F8")
        refused = page.locator(".q-notification", has_text="K1 was already sorted")
        expect(refused.first).to_be_visible()
        assert machine.ask("GET", "/state")[1]["activity"] == "watching"
        scan("K1")
        expect(page.locator(".taken")).to_be_visible()


def test_operator_sees_whose_verdict_it_is_who_controls_and_what_happens_by_itself(
    browser: Browser, address: str
) -> None:
    machine, name = Machine(address), "(01)04012345000016(21)A17"
    with visit_as_driver(browser, f"{address}operate", **PANEL) as page:
        expect_enabled(page, "#grasp")
        page.keyboard.type(name)
        page.keyboard.press("Enter")
        # A long name is shown with its serial number.
        expect(page.locator(".item .q-field__label")).to_have_text("Next item …00016(21)A17")
        page.keyboard.press("F8")
        machine.until(lambda at: at["answered"])
        expect(page.locator("#opens")).to_have_text(re.compile(r"opens automatically in \d+ s"))
        with visit(browser, f"{address}operate") as other:
            for width, height in ((1280, 800), (800, 480), (390, 844)):
                other.set_viewport_size({"width": width, "height": height})
                watched = "Another screen controls (operator's page at 127.0.0.1)"
                expect(other.locator("#next-text")).to_have_text(watched)
            # A scan on the screen that does not control is not taken silently.
            other.keyboard.type("K7")
            other.keyboard.press("Enter")
            expect(other.locator("#next-text")).to_contain_text("NOT TAKEN: press Take over")
        # Without Release, the gripper opens after 60 s of simulated time.
        machine.ready()
        expect(page.locator("#verdict-why")).to_contain_text("opened automatically after 60 s")
        expect(page.locator("#opens")).to_have_text("")
        expect(page.locator("#verdict")).to_have_attribute("data-past", "false")
        # The next scan dims the verdict of the previous item at once.
        page.keyboard.type("K2")
        expect(page.locator("#verdict")).to_have_attribute("data-past", "true")
        page.keyboard.press("Enter")
        # The item before is not finished.
        expect(page.locator(".refused")).to_be_visible()


def test_operator_sees_a_fault_of_the_store_in_few_words_and_in_the_alarms(
    browser: Browser, tmp_path: Path
) -> None:
    (tmp_path / "rules.toml").write_text(RULES.replace("most_grasps = 2", "most_grasps = 1"))
    with (
        serve_dashboard(tmp_path, *AVOCADO, "--rules", str(tmp_path / "rules.toml")) as address,
        visit_as_driver(browser, f"{address}operate", **PANEL) as page,
    ):
        machine = Machine(address)
        for broken in (False, True):
            if broken:
                for file in tmp_path.glob("items.sqlite*"):
                    file.unlink()
                (tmp_path / "items.sqlite").write_text("this is not a database" * 100)
            expect_enabled(page, "#grasp")
            name = "B2" if broken else "B1"
            page.keyboard.type(name)
            page.keyboard.press("Enter")
            expect(page.locator(".taken")).to_be_visible()
            page.keyboard.press("F8")
            machine.until(lambda at: at["answered"])
            if not broken:
                # The page has the answer a moment later.
                expect(page.locator("#verdict-text")).to_have_text(BIN)
            shown = page.locator("#verdict-text").inner_text()
            page.keyboard.press("F9")
            machine.ready()
            result = machine.ask("GET", "/result")[1]
            # The bin shown while the hand holds is the result's, and the stored one.
            assert (result["bin"] is None) == broken
            assert broken or shown.lower() == result["bin"]["name"]
        expect(page.locator("#badge")).to_have_text("NOT STORED: the store can't be used")
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "warn")
        expect(page.locator("#trouble")).to_be_hidden()
        expect(page.locator("#lot")).to_contain_text("items 1")
        # The next item is still this one.
        expect(page.locator("#next-text")).to_have_text("NOT STORED: grasp B2 again")
        expect(page.locator("input.scanned")).to_have_value("B2")
        page.locator("#alarms-title").click()
        expect(page.locator("#alarms-list")).to_contain_text("B2: NOT STORED: the store can't be")
        assert "sqlite" not in page.locator("body").inner_text()
