"""Screenshot of a report for docs/images: `python docs/generate_report.py`.

The script sorts a few simulated items after training and takes a screenshot of the day's report. It
takes minutes and needs Chromium (`apt-get install chromium`) and `pip install 'palpate[dev]'`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from datetime import datetime
from pathlib import Path

from playwright.sync_api import sync_playwright

CHROMIUM = "/usr/bin/chromium"
ROOT = Path(__file__).resolve().parents[1]
VIEW = {"width": 1120, "height": 860}


def palpate(*arguments: str) -> None:
    """Run a palpate command."""
    call = [sys.executable, "-c", "from palpate.cli import main; main()", *arguments]
    subprocess.run(call, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Sort items, write the report and save its screenshot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("--items", type=int, default=5)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as play:
        store, page = str(Path(folder, "items.sqlite")), Path(folder, "report.html")
        crate = ["--rig", "sim-rigid", "--items", str(arguments.items), "--seed", "1"]
        rules = str(ROOT / "examples" / "sorting-rules.toml")
        palpate("sort", "--rules", rules, *crate, "--batch", "Monday", "--store", store)
        today = datetime.now().astimezone().date()
        palpate("report", "--day", f"{today}", "--store", store, "--out", str(page))
        with play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"]) as browser:
            view = browser.new_page(viewport=VIEW, color_scheme="light")
            view.goto(page.as_uri())
            view.screenshot(path=arguments.out / "report-day.png")


if __name__ == "__main__":
    main()
