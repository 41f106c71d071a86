"""The pages in English and German: which is chosen, that it is kept, and that nothing is left."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect
from tests.loop.test_dashboard import (
    SIMULATED,
    browser,
    can_press,
    drive,
    fresh,
    release,
    served,
    verdict,
)
from tests.loop.test_operator_view import SIZES, at

__all__ = ["browser"]

#: What is shown or read out, without names, numbers, and what is English on purpose.
TEXTS = """() => {
    const found = new Set();
    const spared = 'script, style, #language, [lang=en], [lang=en-US] #trouble, .q-icon';
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const around = walker.currentNode.parentElement;
        if (around && !around.closest(spared)) found.add(walker.currentNode.textContent.trim());
    }
    for (const part of document.body.querySelectorAll('[aria-label], [title], [aria-valuetext]'))
        for (const name of ['aria-label', 'title', 'aria-valuetext'])
            if (part.hasAttribute(name)) found.add(part.getAttribute(name).trim());
    return [...found];
}"""
#: Names, units, and words that are the same in both languages.
SAME = {
    "palpate", "STOP", "sim-rigid", "strawberry", "N/mm", "Pause", "Name", "Hz", "mm", "kPa",
    "pixel", "Pixel", "Jitter", "kB", "grasp", "mcap",
}  # fmt: skip


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with served(tmp_path_factory.mktemp("languages"), *SIMULATED) as address:
        yield address


def left_over(english: Page, german: Page) -> set[str]:
    """Return the texts of the German page that the English one has too."""
    both = set(english.evaluate(TEXTS)) & set(german.evaluate(TEXTS))
    known = re.compile("|".join(map(re.escape, sorted(SAME, key=len, reverse=True))))
    return {text for text in both if re.search(r"[^\W\d_]{2}", known.sub("", text))}


def test_no_page_shows_a_text_that_was_not_translated(browser: Browser, address: str) -> None:
    with (
        at(browser, address, SIZES["wide"], locale="en-US") as english,
        at(browser, address, SIZES["wide"], locale="de-DE") as german,
    ):
        for path in ("", "calibrate", "doctor", "recordings", "items", "run", "operate"):
            for page in (english, german):
                page.goto(f"{address}{path}")
                page.wait_for_function("+document.body.dataset.drawn > 3")
            assert left_over(english, german) == set(), path
        english.goto(f"{address}doctor")
        german.goto(f"{address}recordings")
        fresh(english)
        drive(english)
        can_press(english, "#examine")
        english.locator("#examine").click()
        expect(german.locator("#verdict-text")).to_have_text("untersucht")
        english.get_by_role("tab", name="Calibrate").click()
        can_press(english, "#calibrate-rest")
        english.locator("#calibrate-rest").click()
        expect(german.locator("#guide")).to_contain_text("Den Sensor nicht berühren")
        english.get_by_role("tab", name="Recordings").click()
        can_press(english, "#grasp")
        english.locator("#grasp").click()
        verdict(english, "holding")
        verdict(german, "hält")
        assert left_over(english, german) == set()
        release(english)
        verdict(german, "gehalten und zurückgegeben")
        assert left_over(english, german) == set()
        english.get_by_role("button", name="Replay", exact=True).first.click()
        expect(german.get_by_role("button", name="Zurück zum Aufbau")).to_be_attached()
        assert left_over(english, german) == set()
        english.get_by_role("button", name="Back to the rig").click()
        can_press(english, "#grasp")
        for tab in (("Doctor", "Prüfen"), ("Calibrate", "Kalibrieren"), ("Run", "Lauf")):
            for page, name in zip((english, german), tab, strict=True):
                page.get_by_role("tab", name=name).click()
            expect(german.locator(".q-tab-panel")).to_have_count(1)
            assert left_over(english, german) == set(), tab


def test_the_browser_or_the_address_chooses_and_links_keep_it(
    browser: Browser, address: str
) -> None:
    with at(browser, f"{address}operate", SIZES["wide"], locale="de-AT") as page:
        assert page.locator("html").get_attribute("lang") == "de-DE"
        expect(page.locator("#grasp")).to_have_text("Greifen")
        page.get_by_role("link", name="Ganze Seite").click()
        expect(page).to_have_url(address)
        page.goto(f"{address}?lang=en")
        assert page.locator("html").get_attribute("lang") == "en-US"
        page.get_by_role("tab", name="Run").click()
        expect(page).to_have_url(f"{address}run?lang=en")
        page.get_by_role("link", name="Operate").click()
        expect(page).to_have_url(f"{address}operate?lang=en")
        expect(page.locator("#grasp")).to_have_text("Grasp")
    # Of what is not spoken here, English.
    with at(browser, f"{address}?lang=xx", SIZES["wide"], locale="fr-FR") as page:
        assert page.locator("html").get_attribute("lang") == "en-US"


def test_the_choice_in_the_head_of_the_page_is_kept_in_this_browser(
    browser: Browser, address: str
) -> None:
    german = re.compile("de-DE")
    with at(browser, f"{address}operate?lang=en", SIZES["phone"], locale="en-US") as page:
        page.get_by_label("Language").select_option("de")
        expect(page).to_have_url(f"{address}operate")
        expect(page.locator("html")).to_have_attribute("lang", german)
        page.goto(f"{address}run")
        expect(page.locator("html")).to_have_attribute("lang", german)
        expect(page.get_by_label("Sprache")).to_have_value("de")
        page.goto(f"{address}?lang=en")
        expect(page.locator("html")).to_have_attribute("lang", "en-US")
    # Of another browser, that one decides.
    with at(browser, address, SIZES["phone"], locale="en-US") as page:
        expect(page.locator("html")).to_have_attribute("lang", "en-US")


def test_whoever_types_the_token_arrives_where_they_wanted_to(
    browser: Browser, tmp_path: Path
) -> None:
    with served(tmp_path, *SIMULATED, PALPATE_TOKEN="correct-horse") as address:
        context = browser.new_context(locale="en-US")
        page = context.new_page()
        page.goto(f"{address}operate?lang=de")
        assert page.locator("html").get_attribute("lang") == "de-DE"
        page.get_by_label("Kennwort").fill("correct-horse")
        page.get_by_role("button", name="Anmelden").click()
        expect(page).to_have_url(f"{address}operate?lang=de")
        expect(page.locator("#grasp")).to_have_text("Greifen")
        context.close()
