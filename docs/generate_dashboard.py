"""Screenshots of the dashboard for docs/images: `python docs/generate_dashboard.py`.

The script grasps a simulated strawberry and takes screenshots of the page and the operator view,
light and dark, with the bin from a rule. It then takes a screenshot after a stopped force
calibration. Needs Chromium (`apt-get install chromium`) and `pip install 'palpate[dev]'`.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page, expect, sync_playwright

CHROMIUM = "/usr/bin/chromium"
VIEWS = {"dashboard-wide": "", "operate-wide": "operate"}
SIZE = {"width": 1280, "height": 800}
#: Bins by size; the strawberry in the screenshots has 37 mm.
RULES = """default = "by hand"
[[rule]]
bin = "large"
size_mm = [35, 60]
"""


@contextmanager
def serve_rig(folder: Path) -> Iterator[str]:
    """Serve a simulated rig and yield the address."""
    command = [
        sys.executable,
        "-c",
        "from palpate.cli import main; main()",
        "serve",
        "--port",
        "0",
        "--object",
    ]
    command += ["strawberry", "--seed", "3", "--speed", "5", "--folder", str(folder)]
    rules = folder / "rules.toml"
    rules.write_text(RULES)
    command += ["--store", str(folder / "items.sqlite"), "--rules", str(rules)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = re.search(r"http://\S+", process.stdout.readline())
            assert found is not None, "palpate serve did not start"
            yield found[0]
        finally:
            process.terminate()


def take_screenshots(browser: Browser, address: str, out: Path) -> None:
    """Grasp once, then save both views in both color schemes."""
    pages: dict[str, Page] = {}
    for view, path in VIEWS.items():
        for shade in ("light", "dark"):
            context = browser.new_context(viewport=SIZE, color_scheme=shade, locale="en-US")
            page = pages[f"{view}-{shade}"] = context.new_page()
            page.goto(f"{address}{path}")
            expect(page.locator("#link")).to_have_attribute("data-state", "fresh", timeout=30_000)
    driver = pages["dashboard-wide-light"]
    driver.get_by_label("Target force").first.fill("3")
    driver.get_by_label("Item").first.fill("berry-7")
    driver.locator("#grasp").click()
    driver.wait_for_function("+document.querySelector('#curve')?.dataset.bands > 0")
    driver.get_by_role("button", name="1×").click()
    expect(driver.locator("#verdict-text")).to_have_text("large", timeout=60_000)
    driver.mouse.move(640, 20)
    driver.wait_for_function("+document.querySelector('#curve')?.dataset.bands > 30")
    for name, page in pages.items():
        page.screenshot(path=out / f"{name}.png")
    driver.locator("#release").click()
    expect(driver.locator("#grasp")).to_be_enabled(timeout=60_000)
    calibrate_and_stop(driver)
    for shade in ("light", "dark"):
        page = pages[f"dashboard-wide-{shade}"]
        page.get_by_role("tab", name="Calibrate").click()
        expect(page.locator("#calibrated .result")).to_be_visible()
        page.evaluate("document.activeElement.blur()")
        page.mouse.move(640, 20)
        # Wait until the animations of the tab have ended.
        page.wait_for_timeout(1000)
        page.screenshot(path=out / f"calibration-stopped-{shade}.png")


def calibrate_and_stop(driver: Page) -> None:
    """Start a force calibration with the simulated load cell, and stop at a placement."""
    driver.get_by_role("tab", name="Calibrate").click()
    button = driver.locator("#calibrate-force")
    expect(button).to_be_enabled(timeout=60_000)
    button.click()
    # On a fast machine a placement may end before a slower check detects it.
    driver.wait_for_function("/[2-5] of 6/.test(document.querySelector('#guide').textContent)")
    driver.locator("#stop").click()
    expect(driver.locator("#verdict-text")).to_have_text("calibration stopped", timeout=60_000)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "images")
    out = parser.parse_args().out
    with (
        tempfile.TemporaryDirectory() as folder,
        serve_rig(Path(folder)) as address,
        sync_playwright() as play,
        play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]) as browser,
    ):
        take_screenshots(browser, address, out)


if __name__ == "__main__":
    main()
