"""Recordings on the page: list, replay timeline, comparison, rename and delete."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from packages.station.tests.served_pages import (
    ITEM,
    expect_fresh_link,
    expect_verdict,
    grasp,
    open_tab,
    release,
    visit_as_driver,
    wait_for_draws,
)
from playwright.sync_api import Browser, Locator, Page, expect


@pytest.fixture(scope="module")
def page(browser: Browser, address: str) -> Iterator[Page]:
    """A page shared by all tests, with the recording of one grasp."""
    with visit_as_driver(browser, address) as page:
        page.get_by_label(ITEM).fill("berry-7")
        grasp(page)
        # The hold is long enough to be selected on the timeline.
        page.wait_for_function("+document.querySelector('#curve')?.dataset.bands > 15")
        release(page)
        open_tab(page, "Recordings")
        yield page


def row(page: Page) -> Locator:
    return page.locator("#recordings .file").first


def start_replay(page: Page) -> None:
    row(page).get_by_role("button", name="Replay", exact=True).click()
    expect(page.locator("#timeline")).to_be_visible()


def end_replay(page: Page) -> None:
    page.get_by_role("button", name="Back to the rig").click()
    expect(page.locator("#timeline")).to_be_hidden()
    expect_fresh_link(page)


def seek(page: Page, fraction: float) -> None:
    page.locator("#seek").evaluate(
        "(slider, fraction) => { slider.value = +slider.min + fraction * (slider.max - slider.min);"
        " slider.dispatchEvent(new Event('input', { bubbles: true })); }",
        fraction,
    )


def test_replay_timeline_controls_position_pause_and_speed(page: Page) -> None:
    start_replay(page)
    expect(page.locator("#rig-name")).to_contain_text("replay of grasp-")
    expect(page.locator("#link-text")).to_have_text("replay")
    page.locator("#play").click()
    expect(page.locator("#play")).to_have_text("Play")
    expect(page.locator("#phases .phase")).not_to_have_count(0)
    expect(page.locator("#phase-names")).to_contain_text("holding")
    seek(page, 0.0)
    expect(page.locator("#played")).to_have_text(re.compile(r"^0\.0 / "))
    expect(page.locator("#verdict")).to_have_attribute("data-kind", "busy")
    expect(page.locator("#fingers .pad.touching")).to_have_count(0)
    # The whole curve is available from the start.
    for plot in ("force", "curve"):
        expect(page.locator(f"#{plot}-settles")).to_contain_text("forecast")
    seek(page, 0.8)
    expect_verdict(page, "holding")
    expect(page.locator("#fingers .pad.touching")).to_have_count(2)
    at = page.locator("#played").inner_text()
    wait_for_draws(page, 2)
    expect(page.locator("#played")).to_have_text(at)
    # Keyboard: an arrow key moves by 0.01 s, Page Up by a tenth of the recording.
    page.locator("#seek").focus()
    page.keyboard.press("PageUp")
    expect(page.locator("#played")).not_to_have_text(at)
    page.locator("#pace").select_option("10")
    page.locator("#play").click()
    expect_verdict(page, "held and released")
    expect(page.locator("#play")).to_have_text("Again")
    # The sheet still has a reading, but an open hand has no force.
    expect(page.locator("#force-at")).to_have_text("gripper open")
    end_replay(page)
    expect(page.locator("#rig-name")).to_have_text("sim-rigid")


def test_kept_replay_is_overlaid_on_the_next_aligned_at_contact(page: Page, folder: Path) -> None:
    page.get_by_label("Replay speed").get_by_role("button", name="10×").click()
    row(page).get_by_role("button", name="Replay").click()
    expect(page.locator("#verdict-text")).to_have_text("held and released")
    keep = page.get_by_role("button", name="Keep to compare")
    keep.click()
    # Compared with itself, the curve is identical.
    expect(page.locator("#chart")).not_to_have_attribute("data-kept", "0")
    page.locator("#force .u-over").hover()
    same = re.compile(r"^\S+ s: (\d.* N \[.*\]) · kept \1$")
    expect(page.locator("#force-at")).to_have_text(same)
    (first,) = (folder / "data").glob("*.mcap")
    expect(page.locator("#chart .kept-key")).to_contain_text(first.stem)
    end_replay(page)
    # Before the contact, no comparison is drawn.
    expect(page.locator("#chart")).to_have_attribute("data-kept", "0")
    expect(page.locator("#chart .kept-key")).to_be_hidden()
    grasp(page)
    expect(page.locator("#chart")).not_to_have_attribute("data-kept", "0")
    release(page)
    start_replay(page)
    expect(page.locator("#chart")).not_to_have_attribute("data-kept", "0")
    # All elements above the curves have appeared, so the curves no longer move under the pointer.
    expect(page.locator("#guide")).to_be_hidden()
    page.locator("#force .u-over").hover(position={"x": 80, "y": 60})
    expect(page.locator("#force-at")).to_contain_text("kept")
    page.get_by_role("button", name="Stop comparing").click()
    expect(page.locator("#chart")).to_have_attribute("data-kept", "0")
    expect(keep).to_be_visible()
    end_replay(page)
    newest = max((folder / "data").glob("*.mcap"), key=lambda file: file.stat().st_mtime_ns)
    newest.unlink()
    expect(page.locator("#recordings .file")).to_have_count(1)


def test_recording_has_a_url(page: Page, folder: Path) -> None:
    (file,) = (folder / "data").glob("*.mcap")
    open_tab(page, "Run")
    page.locator("#run a[data-recording]").last.click()
    expect(page).to_have_url(re.compile(f"/recordings/{re.escape(file.name)}$"))
    expect(page.get_by_label("Name")).to_have_value(file.stem)
    expect(page.locator("#who")).to_contain_text("you control")
    page.reload()
    expect(page.get_by_label("Name")).to_have_value(file.stem)
    page.locator(".care").get_by_role("button", name="Close").click()
    expect(page).to_have_url(re.compile("/recordings$"))
    row(page).get_by_role("button", name="More").click()
    expect(page).to_have_url(re.compile(f"/recordings/{re.escape(file.name)}$"))
    page.locator(".care").get_by_role("button", name="Replay").click()
    expect(page.locator("#timeline")).to_be_visible()
    end_replay(page)
    page.goto(page.url + "/elsewhere.mcap")
    notice = page.locator(".q-notification").first
    expect(notice).to_contain_text("no such recording in the folder")
    expect(page.locator(".care")).to_have_count(0)
    expect(page).to_have_url(re.compile("/recordings$"))
    expect(page.locator(".q-notification")).to_have_count(0)


def test_recording_can_be_downloaded_renamed_and_deleted(page: Page, folder: Path) -> None:
    (file,) = (folder / "data").glob("*.mcap")
    row(page).get_by_role("button", name="More").click()
    with page.expect_download() as taken:
        page.get_by_role("button", name="Download").click()
    assert taken.value.suggested_filename == file.name
    assert Path(taken.value.path()).read_bytes() == file.read_bytes()
    name = page.get_by_label("Name")
    for wrong in ("../elsewhere", ""):
        name.fill(wrong)
        page.get_by_role("button", name="Rename").click()
        notice = page.locator(".q-notification").first
        expect(notice).to_contain_text("a name may contain only letters")
    name.fill("monday 3")
    page.get_by_role("button", name="Rename").click()
    expect(row(page)).to_contain_text(re.compile("monday 3.*held.*berry-7", re.DOTALL))
    row(page).get_by_role("button", name="More").click()
    page.get_by_role("button", name="Delete").click()
    expect(page.locator(".care")).to_contain_text("This can't be undone")
    assert (folder / "data" / "monday 3.mcap").exists(), "the deletion must be confirmed first"
    page.get_by_role("button", name="Delete permanently").click()
    expect(page.locator("#recordings .file")).to_have_count(0)
    assert list((folder / "data").glob("*.mcap")) == []
