"""The run on the page: grasp after grasp with verdict and bin, and the table of them."""

from __future__ import annotations

import csv
import io
import re
import urllib.request
from pathlib import Path

from playwright.sync_api import Browser, expect
from tests.loop.test_dashboard import (
    PATIENCE_MS,
    SIMULATED,
    WIDE,
    browser,
    fresh,
    grasp,
    release,
    served,
    tab,
)

__all__ = ["browser"]

RULES = """default = "look at it"
[[rule]]
bin = "small"
size_mm = [0, 45]
[[rule]]
bin = "large"
size_mm = [45, 90]
"""


def test_grasps_are_listed_counted_and_sorted(browser: Browser, tmp_path: Path) -> None:
    rules = tmp_path / "rules.toml"
    rules.write_text(RULES)
    with served(tmp_path, *SIMULATED, "--rules", str(rules)) as address:
        context = browser.new_context(viewport=WIDE)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.goto(address)
        fresh(page)
        for name in ("berry-7", ""):
            page.get_by_label("Item (empty: not stored)").fill(name)
            grasp(page)
            release(page)
        tab(page, "Run")
        expect(page).to_have_url(f"{address}run")
        rows = page.locator("#run .ran")
        expect(rows).to_have_count(2)
        expect(rows.nth(0)).to_contain_text("no name")
        named = rows.nth(1)
        expect(named).to_contain_text(re.compile("berry-7.*SIMULATED.*held", re.DOTALL))
        expect(named.locator(".where b")).to_have_text("small")
        expect(named.locator("polyline")).to_be_attached()
        expect(page.locator("#run-counts")).to_contain_text(re.compile("2 grasps since .*: 2 held"))
        expect(page.locator("#run-bins")).to_contain_text("small")
        with urllib.request.urlopen(f"{address}grasps.csv", timeout=30) as reply:
            table = list(csv.DictReader(io.StringIO(reply.read().decode())))
        assert [row["item_id"] for row in table] == ["berry-7", ""]
        assert table[0]["bin"] == "small"
        assert 1.0 < float(table[0]["force_n"]) < 5.0
        # The link turns to the tab of items; who drives goes on driving.
        named.get_by_role("link", name="berry-7").click()
        expect(page.locator("#item-page")).to_contain_text("1 grasp")
        expect(page.locator("#who")).to_contain_text("you drive")
        context.close()
