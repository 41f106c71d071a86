"""A grasp that is cut off by the end of a process: the page says so, and what was in the hand."""

from __future__ import annotations

from pathlib import Path

from packages.station.tests.served_pages import (
    SIMULATED,
    Machine,
    drive,
    kill_devices,
    run_server,
    visit,
)
from packages.station.tests.served_pages import start_grasp as press_grasp
from playwright.sync_api import Browser, Page, expect


def start_grasp(address: str, item_id: str) -> Machine:
    machine = Machine(address)
    machine.ready()
    machine.ask("PUT", "/driver")
    assert machine.ask("POST", "/grasp", {"item_id": item_id})[0] == 202
    machine.until(lambda at: at["phase"] not in (None, "wait"))
    return machine


def expect_interrupted(page: Page, word: str) -> None:
    expect(page.locator("#verdict-text")).to_have_text(word)
    expect(page.locator("#badge")).to_have_text("NOT STORED: interrupted")
    expect(page.locator("#badge")).to_be_visible()
    expect(page.locator("#verdict-why")).to_contain_text("A17 was in the gripper")


def test_page_names_the_item_of_a_grasp_that_a_killed_server_has_cut_off(
    browser: Browser, tmp_path: Path
) -> None:
    with run_server(tmp_path, *SIMULATED) as (address, process):
        start_grasp(address, "A17")
        process.kill()
    with run_server(tmp_path, *SIMULATED) as (address, _):
        machine = Machine(address)
        machine.ready()
        assert machine.ask("GET", "/state")[1]["interrupted"]["item_id"] == "A17"
        assert machine.ask("GET", "/items")[1]["items"] == []
        with visit(browser, f"{address}operate") as page:
            expect_interrupted(page, "Interrupted")
            drive(page)
            expect(page.locator("#next-text")).to_contain_text("Scan A17 again")
            expect(page.locator("#alarms-title")).to_have_text("Alarms: 1")
            press_grasp(page)
            expect(page.locator("#badge")).not_to_contain_text("interrupted")
            assert machine.ask("POST", "/stop")[0] == 200
        assert '"grasp of A17 interrupted, not stored' in (
            (tmp_path / "data" / "audit.jsonl").read_text()
        )
        assert machine.ask("GET", "/state")[1]["interrupted"] is None


def test_page_names_the_item_in_the_hand_of_devices_that_have_ended(
    browser: Browser, tmp_path: Path
) -> None:
    with (
        run_server(tmp_path, *SIMULATED) as (address, process),
        visit(browser, f"{address}operate") as page,
    ):
        machine = start_grasp(address, "A17")
        kill_devices(process)
        machine.until(lambda at: at["activity"] == "gone")
        expect_interrupted(page, "Out of order")
        assert machine.ask("GET", "/state")[1]["interrupted"]["item_id"] == "A17"
