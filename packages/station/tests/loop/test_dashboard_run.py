"""Several grasps on the page, with verdict, bin and table."""

from __future__ import annotations

import csv
import io
import re
import urllib.request
from pathlib import Path

from packages.station.tests.served_pages import (
    ITEM,
    SIMULATED,
    Machine,
    drive,
    expect_fresh_link,
    open_tab,
    serve_dashboard,
    start_grasp,
    visit,
)
from playwright.sync_api import Browser, expect
from tests.whole.test_json_schemas import faults

from palpate.cli import build_app, run

RULES = """default = "by hand"
[[rule]]
bin = "small"
size_mm = [0, 38.5]
"""
#: Object of the simulated rig, the name given to it, its bin and the colour of the headline.
SORTED = (
    ("strawberry", "berry-7", "small", "good"),
    ("rigid-block", "", "by hand", "warn"),
)


def test_bin_is_the_headline_and_equal_on_page_api_and_table(
    browser: Browser, tmp_path: Path
) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(RULES)
    with (
        serve_dashboard(tmp_path, *SIMULATED, "--rules", str(rules)) as address,
        visit(browser, address) as page,
        visit(browser, f"{address}operate") as operator,
    ):
        for one in (page, operator):
            expect_fresh_link(one)
        drive(page)
        machine, documents = Machine(address), []
        for number, (thing, name, bin_name, kind) in enumerate(SORTED):
            if number:
                page.get_by_label("Object between the fingers").click()
                page.get_by_role("option", name=thing, exact=True).click()
                page.locator("#use-rig").click()
                expect(page.locator("#fingers")).to_contain_text(thing.replace("-", " "))
            page.get_by_label(ITEM).fill(name)
            start_grasp(page)
            # The bin is shown during the hold, and a screen that watches asks for nothing.
            expect(operator.locator("#next-text")).to_contain_text("Another screen controls")
            for one in (page, operator):
                expect(one.locator("#verdict-text")).to_have_text(bin_name, ignore_case=True)
                expect(one.locator("#verdict")).to_have_attribute("data-kind", kind)
            page.locator("#release").click()
            # At the end of the activity, result and item are available.
            state = machine.until(lambda at: at["activity"] == "watching")
            result = machine.ask("GET", "/result")[1]
            documents.append(result)
            assert (result["bin"]["name"], result["object"]) == (bin_name, thing)
            assert faults("grasp", result) == []
            assert state["bin"] == bin_name
            assert result.get("item_id", "") == name
            if name:
                assert result["item"] == {"id": name, "kind": None, "stage": None, "bruised": None}
                item = machine.ask("GET", f"/items/{name}")[1]
                assert item["grasps"][0]["recording"].endswith(result["recording"])
                assert [one["text"] for one in item["verdicts"]] == [bin_name]
            for one in (page, operator):
                expect(one.locator("#verdict-text")).to_have_text(bin_name, ignore_case=True)
                expect(one.locator("#verdict")).to_have_attribute("data-kind", kind)
                size = f"{result['size_mm']['value']:.1f} mm"
                expect(one.locator("#verdict-firm")).to_contain_text(size)
        open_tab(page, "Run")
        expect(page).to_have_url(f"{address}run")
        rows = page.locator("#run .ran")
        expect(rows).to_have_count(2)
        expect(rows.nth(0)).to_contain_text("no name")
        named = rows.nth(1)
        expect(named).to_contain_text(re.compile("berry-7.*SIMULATED.*held", re.DOTALL))
        expect(named.locator(".where b")).to_have_text("small")
        expect(named.locator("polyline")).to_be_attached()
        expect(page.locator("#run-counts")).to_contain_text(re.compile("2 grasps since .*: 2 held"))
        for _, _, bin_name, _ in SORTED:
            expect(page.locator("#run-bins")).to_contain_text(bin_name)
        with urllib.request.urlopen(f"{address}grasps.csv", timeout=30) as reply:
            table = list(csv.DictReader(io.StringIO(reply.read().decode())))
        for row, result in zip(table, documents, strict=True):
            assert row["item_id"] == result.get("item_id", "")
            assert (row["bin"], row["bin_why"]) == (result["bin"]["name"], result["bin"]["why"])
            assert row["recording"] == result["recording"]
            assert float(row["size_mm"]) == result["size_mm"]["value"]
        # The link shows the tab Items, and the driver stays the same.
        named.get_by_role("link", name="berry-7").click()
        expect(page.locator("#item-page")).to_contain_text("1 grasp")
        expect(page.locator("#item-page")).to_contain_text("small")
        expect(page.locator("#item-page")).to_contain_text("SIMULATED")
        expect(page.locator("#who")).to_contain_text("you control")
        # The input receives no pointer events; users press the surrounding field.
        page.locator("label").filter(has=page.get_by_label("Item", exact=True)).click()
        expect(page.get_by_role("option", name="berry-7")).to_be_visible()
        report = ("report", "berry-7", "--store", str(tmp_path / "items.sqlite"))
        out = tmp_path / "report.html"
        assert run(build_app(), [*report, "--out", str(out)], name="palpate") == 0
        assert ">small<" in out.read_text()
