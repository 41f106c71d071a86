"""The documentation's page that plays a recorded grasp, in a browser and without a server."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from tests.pages import ROOT

pytestmark = [pytest.mark.system, pytest.mark.slow]
CHROMIUM = Path("/usr/bin/chromium")


def test_page_plays_recorded_grasp_from_the_disk(tmp_path: Path) -> None:
    api = pytest.importorskip("playwright.sync_api")
    if not CHROMIUM.exists():
        pytest.skip(f"no {CHROMIUM}: apt-get install chromium")
    build = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    elsewhere: list[str] = []
    errors: list[str] = []
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("request", lambda r: elsewhere.append(r.url) if "http" in r.url[:5] else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto((tmp_path / "play" / "index.html").as_uri())
        slider, verdict = (
            page.locator("#grasp-player input"),
            page.locator("#grasp-player .verdict"),
        )
        for number in range(page.locator("#grasp-player select >> nth=0 >> option").count()):
            page.locator("#grasp-player select").first.select_option(index=number)
            slider.fill("0")
            assert verdict.text_content() == ""
            slider.fill(str(slider.get_attribute("max")))
            assert "held" in str(verdict.text_content())
            band = page.locator("#grasp-player polygon").get_attribute("points")
            assert len(str(band).split()) > 100
            assert page.locator("#grasp-player li").count() >= 2
        slider.fill("0")
        page.get_by_role("button", name="Play").click()
        page.wait_for_function("document.querySelector('#grasp-player input').value > 0.2")
        browser.close()
    assert elsewhere == errors == []
