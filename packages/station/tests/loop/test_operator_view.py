"""The operator's page, its sound, and the accessibility of all pages."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest
from axe_playwright_python.sync_playwright import Axe
from packages.station.tests.served_pages import (
    ITEM,
    PHONE,
    SIMULATED,
    SLOWER,
    TARGET,
    Machine,
    drive,
    expect_enabled,
    expect_fresh_link,
    expect_verdict,
    open_tab,
    release,
    serve_dashboard,
    start_grasp,
    visit,
    visit_as_driver,
    wait_for_draws,
)
from playwright.sync_api import Browser, Page, expect

from palpate.grasp.verdict import UNKNOWN_FIRMNESS, firmness
from palpate.measurement import Measurement
from palpate_station.dashboard.grasp_form import short_name
from palpate_station.dashboard.words import Words

#: A phone, a tablet, a large screen, panel PCs, a landscape phone, and 1280 x 720 at 200 % zoom.
SIZES = [
    *((390, 844), (820, 1180), (1920, 1080)),
    *((800, 480), (1024, 600), (1280, 720), (844, 390), (640, 360)),
]
#: Minimum font sizes for reading from two metres, px: next step and force.
NEXT_PX, FORCE_PX = 20, 40
OUTSIDE = """() => [...document.querySelectorAll('#verdict-why, #verdict-text, %s')]
.filter((part) => {
    const box = part.getBoundingClientRect();
    return box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight;
}).map((part) => part.id)"""
OVERLAP = """() => {
    const boxes = [...document.querySelectorAll('%s')].map((part) => part.getBoundingClientRect());
    return boxes.some((a, i) => boxes.some((b, k) => i < k && a.left < b.right - 1
        && b.left < a.right - 1 && a.top < b.bottom - 1 && b.top < a.bottom - 1));
}"""
PARTS = "#verdict, #next-step, .force, .item, #grasp, #release, #stop"


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    with serve_dashboard(folder, *SIMULATED, *SLOWER) as address:
        yield address


@pytest.fixture(autouse=True)
def hand_left_open(address: str) -> Iterator[None]:
    yield
    Machine(address).leave_hand_open()


def resize(page: Page, size: tuple[int, int]) -> None:
    page.set_viewport_size({"width": size[0], "height": size[1]})
    page.wait_for_function("([width, height]) => innerWidth === width", arg=list(size))


def expect_fit(page: Page) -> None:
    """Check that everything is visible without overlap and scrolling."""
    assert page.evaluate(OUTSIDE % PARTS) == []
    assert not page.evaluate(OVERLAP % PARTS)
    root = "document.documentElement"
    beyond = f"[{root}.scrollHeight - innerHeight, {root}.scrollWidth - innerWidth]"
    assert page.evaluate(beyond) == [0, 0]


def get_font_px(page: Page, part: str) -> float:
    return page.evaluate(f"parseFloat(getComputedStyle(document.querySelector('{part}')).fontSize)")


def list_firmness_texts() -> Iterator[str]:
    """Yield every firmness text, from every pair of bounds."""
    stiffnesses = (0.5, 2.0, 5.0, 12.0, 50.0)
    yield UNKNOWN_FIRMNESS
    for low, high in product(stiffnesses, repeat=2):
        if low <= high:
            yield firmness(Measurement(value=low, low=low, high=high, unit="n_per_mm"))
    for end in stiffnesses:
        for low, high in ((end, 1e6), (1e-6, end)):
            wide = Measurement(value=end, low=low, high=high, unit="n_per_mm")
            yield firmness(wide.or_bound("wide", least=0.02, most=500.0))


#: Lays out each text in the page's font; returns the texts that do not fit.
FIT_TEXTS = """async ([words, nexts, whys, firm, badge]) => {
    await document.fonts.ready;
    const [word, why, next, size] = ['verdict-text', 'verdict-why', 'next-text', 'verdict-firm']
        .map((id) => document.getElementById(id));
    const parts = ['#verdict', '#verdict-text', '#verdict-why', '#shape', '#next-step',
        '#next-text', '.force', '.item', '#grasp', '#stop']
        .map((one) => document.querySelector(one));
    document.getElementById('verdict').dataset.bin = firm !== '';
    const item = document.getElementById('verdict-item');
    const note = document.getElementById('badge'), opens = document.getElementById('opens');
    const out = (part) => {
        const box = part.getBoundingClientRect();
        return box.left < 0 || box.top < 0 || box.right > innerWidth || box.bottom > innerHeight;
    };
    const over = (inner, outer) => {
        const [a, b] = [inner, outer].map((part) => part.getBoundingClientRect());
        return a.right > b.right || a.bottom > b.bottom || a.left < b.left || a.top < b.top;
    };
    const failed = [];
    for (let i = 0; i < Math.max(words.length, nexts.length); i += 1) {
        word.textContent = words[i % words.length];
        next.textContent = nexts[i % nexts.length];
        why.textContent = whys[i % whys.length];
        size.textContent = firm;
        note.textContent = badge;
        item.textContent = badge && '…00016(21)A17';
        opens.textContent = badge && 'opens automatically in 58 s';
        const letters = Math.max(...word.textContent.split(' ').map((one) => one.length));
        document.getElementById('verdict').style.setProperty('--letters', letters);
        // The page scales the texts in a microtask after each change.
        await null;
        const [card, step] = [parts[0], parts[4]];
        if (parts.some(out) || over(word, card) || (firm && over(size, card))
            || (badge && (over(note, card) || over(opens, step)))
            || over(why, card) || over(next, step)
            || word.scrollWidth > word.clientWidth || next.scrollWidth > step.clientWidth
            || document.documentElement.scrollHeight > innerHeight)
            failed.push(`${word.textContent} | ${next.textContent} | ${why.textContent}`);
    }
    return failed;
}"""


#: Shows the headline of a lost connection; returns the texts that exceed the card.
FIT_LOSS_TEXTS = """async (words) => {
    const [card, title] = ['lost', 'lost-title'].map((id) => document.getElementById(id));
    document.body.classList.add('lost');
    card.classList.remove('hidden');
    const beyond = [];
    for (const one of words) {
        title.textContent = one;
        const letters = Math.max(...one.split(' ').map((word) => word.length));
        card.style.setProperty('--letters', letters);
        await null;
        const [a, b] = [title, card].map((part) => part.getBoundingClientRect());
        if (a.top < b.top || a.bottom > b.bottom || a.right > b.right) beyond.push(one);
    }
    return beyond;
}"""


def test_operator_page_fits_every_possible_text_at_every_size(
    browser: Browser, address: str
) -> None:
    texts = Words().texts
    starts = ("phase.", "outcome.", "word.", "activity.")
    words = [text for key, text in texts.items() if key.startswith(starts)]
    words += list_firmness_texts()
    capital = [word[:1].upper() + word[1:] for word in words]
    name = "(01)04012345000016(21)A17"
    nexts = [text for key, text in texts.items() if key.startswith("next.")]
    doubts = ("item.unfinished", "item.not_stored", "item.sorted", "item.scanned")
    doubts += ("item.not_measured", "next.interrupted")
    short = {"item": short_name(name), "other": short_name(name), "bin": "large", "at": "13:30"}
    nexts += [texts[key].format(**short) for key in doubts]
    nexts += [texts["watch"].format(name="operator's page at 192.168.100.200")]
    details = [text for key, text in texts.items() if key.startswith("detail.")]
    details.append(texts["interrupted"].format(item=name, at="14:05"))
    held = ["within the target of 12.5 N · answer 12.7 s after contact"]
    measured = "firmness 100 of 100, 137 mm"
    bins = ["by hand", "large", "look at it by hand", "supermarket-class-2", "Rückläufer Tor 12"]
    evidence = "kiwi 55 % or lime 40 %, 137.2 mm (136.1 to 138.4), firmness 48 (18 to 79)"
    reason = "below the target of 12.5 N · answer 12.7 s after contact"
    unnamed, lost = (texts["badge.unnamed"], "NOT STORED: " + texts["fault.away"])
    cards = (
        [capital, nexts, details, "", ""],
        [list(list_firmness_texts()), nexts, held, measured, unnamed],
        [bins, nexts, [reason], evidence, lost],
    )
    losses = ["No connection", "The devices do not respond"]
    with visit_as_driver(browser, f"{address}operate") as page:
        for size in SIZES:
            resize(page, size)
            wait_for_draws(page, 2)
            expect_fit(page)
            beyond = [text for card in cards for text in page.evaluate(FIT_TEXTS, card)]
            assert beyond == [], size
        for size in SIZES:
            resize(page, size)
            assert page.evaluate(FIT_LOSS_TEXTS, losses) == [], size


def test_operator_page_guides_through_a_grasp_a_reload_a_lost_connection_and_a_stop(
    browser: Browser, address: str
) -> None:
    with visit_as_driver(browser, f"{address}operate", viewport=PHONE, **CALM) as page:
        expect(page.locator("#next-text")).to_have_text(re.compile("^Put the next item in"))
        start_grasp(page)
        expect(page.locator("#next-text")).to_have_text("Keep your hands away")
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "busy")
        expect(page.locator("#next-text")).to_have_text("Take the item, then press Release")
        expect_verdict(page, re.compile("^(Holding|.*(soft|medium|firm).*)$", re.IGNORECASE))
        expect(page.locator("#shape")).to_have_attribute("href", "#shape-good")
        expect(page.locator("#force-now")).to_have_text(re.compile(r"^[1-4]\.\d$"))
        for size in ((1920, 1080), (820, 1180), (PHONE["width"], PHONE["height"])):
            resize(page, size)
            wait_for_draws(page, 2)
            expect_fit(page)
            assert get_font_px(page, "#verdict-text") >= 72
            assert get_font_px(page, "#next-text") >= NEXT_PX
            assert get_font_px(page, "#force-now") >= FORCE_PX
        page.reload()
        expect(page.locator("#next-text")).to_have_text("Take the item, then press Release")
        expect(page.locator("#who")).to_contain_text("you control")
        check_accessibility(page)
        page.get_by_label("Next item").fill("berry-11")
        page.context.set_offline(True)
        expect(page.locator("#lost")).to_be_visible()
        check_accessibility(page)
        page.context.set_offline(False)
        expect_fresh_link(page)
        expect(page.get_by_label("Next item")).to_have_value("berry-11")
        release(page)
        expect(page.locator("#next-text")).to_have_text(re.compile("^Put the next item in"))
        expect(page.locator("#force-now")).to_have_text("gripper open")
        page.get_by_label("Next item").fill("")
        expect(page.locator(".taken")).to_have_count(0)
        start_grasp(page)
        expect(page.locator("#force-now")).to_have_text(re.compile(r"^[1-9]\.\d$"))
        page.locator("#stop").click()
        expect_verdict(page, "Stopped")
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "bad")
        expect(page.locator("#shape")).to_have_attribute("href", "#shape-bad")
        expect(page.locator("#next-text")).to_have_text(
            re.compile("ress Release: the gripper opens$")
        )
        # The hand still grips, and the headline is not repeated below.
        expect(page.locator("#force-now")).to_have_text(re.compile(r"^\d\.\d$"))
        # The answer may precede the press, because the page runs in real time.
        why = re.compile(r"^(answer .* after contact)?\s*$")
        expect(page.locator("#verdict-why")).to_have_text(why)
        expect_fit(page)
        check_accessibility(page)
        release(page)
        expect(page.locator("#force-now")).to_have_text("gripper open")
        expect_verdict(page, "Stopped, gripper open")
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "idle")
        expect_fit(page)


def test_operator_page_reports_a_damaged_item_once(browser: Browser, address: str) -> None:
    with visit_as_driver(browser, address) as page:
        page.get_by_label(TARGET).fill("14")
        start_grasp(page)
        # A crushed object yields, which ends the grasp.
        expect_verdict(page, "the object was damaged")
        # The mark is at the time of the damage during the closing.
        at_s = {
            name: float(
                page.locator(f"#moments [data-name={name}]").get_attribute("data-at") or "nan"
            )
            for name in ("contact", "damaged")
        }
        assert at_s["contact"] < at_s["damaged"]
        page.get_by_label(TARGET).fill("")
        page.goto(f"{address}operate")
        expect_verdict(page, "Damaged")
        expect(page.locator("#next-text")).to_have_text("Set this item aside")
        expect(page.locator("#verdict-why")).not_to_contain_text("damaged")
        expect_fit(page)


def test_grasp_form_survives_a_reload_and_is_shared_by_all_viewers(
    browser: Browser, address: str
) -> None:
    with visit_as_driver(browser, address) as page:
        page.get_by_label(TARGET).fill("3")
        page.get_by_label(ITEM).fill("berry-9")
        with visit_as_driver(browser, f"{address}operate") as other:
            expect(other.get_by_label("Next item")).to_have_value("berry-9")
            expect(other.locator("#force-target")).to_have_text("target: 3 N")
            other.get_by_label("Next item").fill("berry-10")
            expect(page.get_by_label(ITEM)).to_have_value("berry-10")
        page.reload()
        expect(page.get_by_label(ITEM)).to_have_value("berry-10")
        # Only the driver can change the settings, and the other viewer took over.
        drive(page)
        expect(page.get_by_label(TARGET)).to_have_value("3")
        for name in (TARGET, ITEM):
            page.get_by_label(name).fill("")
        page.wait_for_function(
            "fetch('/live').then((r) => r.json()).then("
            "(doc) => doc.operator.target === 'gentle squeeze')"
        )


#: Disables animations, because transitional colours would fail the contrast checks.
CALM = {"reduced_motion": "reduce"}
CONTRAST_ONLY = {"runOnly": {"type": "rule", "values": ["color-contrast"]}}


def check_accessibility(page: Page) -> None:
    """Check all rules, and those of colours also in the dark and with the system's colours."""
    # The framework places tooltips outside of all landmarks, so none may be shown.
    page.mouse.move(5, 5)
    expect(page.locator(".q-tooltip")).to_have_count(0)
    results = [Axe().run(page)]
    page.emulate_media(color_scheme="dark")
    expect(page.locator("body")).to_have_class(re.compile("body--dark"))
    results.append(Axe().run(page, options=CONTRAST_ONLY))
    page.emulate_media(color_scheme="light", forced_colors="active")
    expect(page.locator("body")).to_have_class(re.compile("body--light"))
    results.append(Axe().run(page, options=CONTRAST_ONLY))
    page.emulate_media(forced_colors="none")
    for found in results:
        assert found.violations_count == 0, found.generate_report()


#: Contrast of an element's text with its background (WCAG 2), including opacity.
CONTRAST = """(name) => {
    const part = document.querySelector(name);
    const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
    const solid = (one) => (rgb(getComputedStyle(one).backgroundColor)[3] ?? 1) === 1;
    const light = (c) => [0.2126, 0.7152, 0.0722].reduce((sum, w, i) => {
        const v = c[i] / 255;
        return sum + w * (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
    }, 0);
    let ground = part, faded = 1;
    while (!solid(ground)) ground = ground.parentElement;
    for (let one = part; one; one = one.parentElement) faded *= +getComputedStyle(one).opacity;
    const behind = rgb(getComputedStyle(ground).backgroundColor).slice(0, 3);
    const own = rgb(getComputedStyle(part).color);
    const letters = behind.map((v, i) => faded * own[i] + (1 - faded) * v);
    const [a, b] = [light(letters), light(behind)].sort((x, y) => y - x);
    return (a + 0.05) / (b + 0.05);
}"""


def check_contrast(page: Page, element: str) -> None:
    for shade in ("dark", "light"):
        page.emulate_media(color_scheme=shade)
        expect(page.locator("body")).to_have_class(re.compile(f"body--{shade}"))
        assert page.evaluate(CONTRAST, element) >= 4.5


def test_pages_have_no_accessibility_violations(browser: Browser, address: str) -> None:
    with visit_as_driver(browser, address, **CALM) as page:
        assert page.locator("html").get_attribute("lang") == "en-US"
        assert (page.locator("h1").count(), page.locator("main").count()) == (1, 1)
        expect_enabled(page, "#grasp")
        for tab in ("Set up", "Calibrate", "Doctor", "Items", "Run", "Recordings"):
            open_tab(page, tab)
            expect(page.get_by_role("tab", name=tab)).to_have_attribute("aria-selected", "true")
            expect(page.locator(".q-tab-panel")).to_have_count(1)
            check_accessibility(page)
        start_grasp(page)
        expect_verdict(page, "holding")
        page.locator(".cell").first.click()
        expect(page.locator("#pixel")).to_be_visible()
        check_accessibility(page)
        release(page)
        page.get_by_role("button", name="Replay", exact=True).first.click()
        expect(page.locator("#timeline")).to_be_visible()
        check_accessibility(page)
        page.get_by_role("button", name="Back to the rig").click()
        expect_fresh_link(page)
        page.get_by_role("button", name="More about").first.click()
        expect(page.locator(".care")).to_be_visible()
        check_accessibility(page)
        page.locator(".care").get_by_role("button", name="Close").click()
        with visit_as_driver(browser, f"{address}operate", **CALM) as operator:
            expect_enabled(operator, "#grasp")
            check_accessibility(operator)
            # The page opened last is the driver. Axe skips disabled elements, as of the other one.
            expect(page.locator("#grasp")).to_be_disabled()
            check_contrast(page, "#grasp")
            page.context.set_offline(True)
            expect(page.locator("#lost-title")).to_have_text("No connection")
            check_contrast(page, "#measure-size_mm .value")


#: Records the pitch of every tone that the browser plays.
LISTEN = """window.heard = [];
const start = OscillatorNode.prototype.start;
OscillatorNode.prototype.start = function (when) {
    if (this.context.state === 'running') window.heard.push(this.frequency.value);
    return start.call(this, when);
};"""
DONE_HZ, FAULT_HZ = 880, 220


def expect_tones(page: Page, tones: list[int]) -> None:
    page.wait_for_function("count => window.heard.length >= count", arg=len(tones))
    assert page.evaluate("window.heard") == tones


def test_sound_is_off_by_default_and_differs_for_done_and_fault(
    browser: Browser, address: str
) -> None:
    with visit(browser, "about:blank") as page:
        page.add_init_script(LISTEN)
        page.goto(f"{address}operate")
        expect_fresh_link(page)
        drive(page)
        start_grasp(page)
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "good")
        release(page)
        expect_tones(page, [])
        button = page.get_by_role("button", name="Sound")
        expect(button).to_have_attribute("aria-pressed", "false")
        button.click()
        expect(button).to_have_attribute("aria-pressed", "true")
        # Enabling the sound plays a tone to demonstrate its volume.
        expect_tones(page, [DONE_HZ])
        # The browser stores the setting and may play sound after a user interaction.
        page.reload()
        expect_fresh_link(page)
        expect(button).to_have_attribute("aria-pressed", "true")
        start_grasp(page)
        expect_tones(page, [DONE_HZ])
        page.locator("#stop").click()
        expect(page.locator("#verdict")).to_have_attribute("data-kind", "bad")
        expect_tones(page, [DONE_HZ, FAULT_HZ])
        release(page)
        page.context.set_offline(True)
        expect(page.locator("#lost-title")).to_have_text("No connection")
        expect_tones(page, [DONE_HZ, FAULT_HZ, FAULT_HZ])
