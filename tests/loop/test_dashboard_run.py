"""Several grasps on the page, with verdict, bin and table."""

from __future__ import annotations

import csv
import io
import re
import urllib.request
from pathlib import Path

from playwright.sync_api import Browser, expect
from tests.loop.test_dashboard import (
    SIMULATED,
    TIMEOUT_MS,
    WIDE,
    browser,
    drive,
    expect_enabled,
    expect_fresh_link,
    open_tab,
    serve_dashboard,
)
from tests.loop.test_dashboard_api import Machine
from tests.unit.test_json_schemas import faults

from palpate.cli import build_app, run

#: Label of the item's field on the page, with a hint if it is empty.
ITEM = re.compile(r"^Item(:|$)")

__all__ = ["browser"]

RULES = """default = "by hand"
[[rule]]
bin = "small"
size_mm = [0, 38.5]
[[rule]]
bin = "large"
size_mm = [45, 90]
"""
#: Object of the simulated rig, the name given to it, its bin and the colour of the headline.
SORTED = (
    ("strawberry", "berry-7", "small", "good"),
    ("ball-33lbs", "", "large", "good"),
    ("rigid-block", "block-1", "by hand", "warn"),
)


def test_bin_is_the_headline_and_equal_on_page_api_and_table(
    browser: Browser, tmp_path: Path
) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(RULES)
    options = {"viewport": WIDE}
    with serve_dashboard(tmp_path, *SIMULATED, "--rules", str(rules)) as address:
        page, operator = (browser.new_context(**options).new_page() for _ in range(2))
        for one, url in ((page, address), (operator, f"{address}operate")):
            one.set_default_timeout(TIMEOUT_MS)
            one.goto(url)
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
            expect_enabled(page, "#grasp")
            page.locator("#grasp").click()
            # The bin is shown during the hold.
            expect(operator.locator("#next-text")).to_have_text("Take the item, then press Release")
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
                size = f"{result['size_mm']['value']:.0f} mm"
                expect(one.locator("#verdict-firm")).to_contain_text(size)
        open_tab(page, "Run")
        expect(page).to_have_url(f"{address}run")
        rows = page.locator("#run .ran")
        expect(rows).to_have_count(3)
        expect(rows.nth(1)).to_contain_text("no name")
        named = rows.nth(2)
        expect(named).to_contain_text(re.compile("berry-7.*SIMULATED.*held", re.DOTALL))
        expect(named.locator(".where b")).to_have_text("small")
        expect(named.locator("polyline")).to_be_attached()
        expect(page.locator("#run-counts")).to_contain_text(re.compile("3 grasps since .*: 3 held"))
        for _, _, bin_name, _ in SORTED:
            expect(page.locator("#run-bins")).to_contain_text(bin_name)
        with urllib.request.urlopen(f"{address}grasps.csv", timeout=30) as reply:
            table = list(csv.DictReader(io.StringIO(reply.read().decode())))
        for row, result in zip(table, documents, strict=True):
            assert row["item_id"] == result.get("item_id", "")
            assert (row["bin"], row["why"]) == (result["bin"]["name"], result["bin"]["why"])
            assert row["recording"] == result["recording"]
            assert float(row["size_mm"]) == result["size_mm"]["value"]
        # The link shows the tab Items, and the driver stays the same.
        named.get_by_role("link", name="berry-7").click()
        expect(page.locator("#item-page")).to_contain_text("1 grasp")
        expect(page.locator("#item-page")).to_contain_text("small")
        expect(page.locator("#who")).to_contain_text("you drive")
        report = ("report", "berry-7", "--store", str(tmp_path / "items.sqlite"))
        out = tmp_path / "report.html"
        assert run(build_app(), [*report, "--out", str(out)], name="palpate") == 0
        assert ">small<" in out.read_text()
        for one in (page, operator):
            one.context.close()
