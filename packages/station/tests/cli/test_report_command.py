"""`palpate report`: a self-contained page about items of the store."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import timedelta
from html.parser import HTMLParser
from pathlib import Path

import pytest
from packages.station.tests.cli.stored import stored_grasp
from packages.station.tests.factories import NOON
from tests.commands import Command

from palpate.grasp.result import Outcome
from palpate.measurement import Status
from palpate_station.records import About, Grasp, Item, Source, Verdict
from palpate_station.store import Store

VALUES = {"size_mm": 62.5, "force_n": 2.5, "stiffness_n_per_mm": 4.25, "settled_percent": -31.0}
VOID = {"meta", "br", "img", "link"}


class Checker(HTMLParser):
    """Checks that elements are closed in order and refer to no other file; counts them."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: list[str] = []
        self.feed(page)
        assert self.open == []
        assert "script" not in self.tags
        assert not re.search(r"url\((?!#)|@import", page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            assert name not in ("src", "href"), value
            assert name != "xlink:href" or str(value).startswith("#")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def verdict(item_id: str, text: str, **known: object) -> Verdict:
    usual = {"about": About.RIPENESS, "given_at": NOON}
    return Verdict(item_id=item_id, text=text, **(usual | known))  # type: ignore[arg-type]


def grasp(item_id: str, *, hours: float) -> Grasp:
    return stored_grasp(
        item_id,
        {name: value - hours / 100 for name, value in VALUES.items()},
        hours=hours,
        status=Status.OK if hours else Status.SATURATED,
        outcome=Outcome.HELD if hours else Outcome.SLIPPED,
        pixel_settled_percent=((-31.0, -30.0), (None, -45.0)),
        angle_deg=90.0,
    )


@pytest.fixture(autouse=True)
def store(folder: Path) -> None:
    with Store.open() as store:
        for number, kind in enumerate(["avocado", "avocado", "<kiwi> & co"]):
            name = f"i{number}"
            store.add_item(Item(item_id=name, kind=kind, batch="Monday", first_seen=NOON))
            for day in range(3):
                store.add_grasp(grasp(name, hours=24 * day + number))
            stage = "ripe" if number else "hard"
            store.add_verdict(verdict(name, stage, probability=0.875, explanation="1.5 < 2 N/mm"))
            later = NOON + timedelta(hours=5)
            store.add_verdict(verdict(name, "ripe", given_at=later, source=Source.PERSON))


@pytest.fixture
def report(palpate: Command) -> Callable[..., str]:
    """Return a function that writes a report and returns its HTML."""

    def write(*arguments: str) -> str:
        palpate("report", *arguments, "--out", "page.html")
        page = Path("page.html").read_text(encoding="utf-8")
        Path("page.html").unlink()
        return page

    return write


def test_report_of_an_item_shows_its_grasps(report: Callable[..., str]) -> None:
    page = report("i0")
    assert Checker(page).tags.count("svg") == 4
    for words in ("simulated on the twin", "3 grasps", "3.77", "1.5 &lt; 2 N/mm", "90°", "slipped"):
        assert words in page


@pytest.mark.slow
def test_report_of_a_batch_shows_its_items_stages_and_days_and_of_a_day_its_grasps(
    report: Callable[..., str],
) -> None:
    page = report("--batch", "Monday")
    assert "&lt;kiwi&gt; &amp; co" in page
    assert "<kiwi>" not in page
    tags = Checker(page).tags
    assert tags.count("svg") == 3
    assert tags.count("tr") == 1 + 3
    days = {"days_to_ripe": 1.25, "days_to_ripe_low": 0.0, "days_to_ripe_high": 2.5}
    with Store.open() as store:
        for name, stage in (("i0", "overripe"), ("i1", "overripe"), ("i2", "hard")):
            details = {"probabilities": {"hard": 0.1, "ripe": 0.1, "overripe": 0.8}} | days
            later = NOON + timedelta(hours=9)
            store.add_verdict(verdict(name, stage, given_at=later, details=details))
    page = report("--batch", "Monday")
    assert "1.2 (now to 2.5)" in page
    bars = page[page.index("Ripeness") :]
    assert bars.index("hard") < bars.index("overripe")

    page = report("--day", f"{NOON.astimezone():%Y-%m-%d}")
    assert "4.25 *" in page
    assert "3.77" not in page
    Checker(page)


def test_report_of_a_batch_names_provisional_bins(report: Callable[..., str]) -> None:
    with Store.open() as store:
        for name, bin_name, again in (("i0", "large", False), ("i1", "misshapen", True)):
            details = {"provisional": again}
            store.add_verdict(verdict(name, bin_name, about=About.BIN, details=details))
    page = report("--batch", "Monday")
    # In the table, and not among the counts.
    assert page.count("misshapen, provisional") == page.count("misshapen") == 1
    assert "1 not finished, 1 without a bin" in page


def test_report_file_is_named_after_its_item_and_not_overwritten(palpate: Command) -> None:
    names = ("A17", "A/17 (left)", "A 17 (left)")
    with Store.open() as store:
        for name in names:
            store.add_item(Item(item_id=name))
    for name in names:
        palpate("report", name)
    page = Path("report-A17.html")
    assert "0 grasps" in page.read_text()
    assert len(list(Path().glob("report-A-17-left-*.html"))) == 2
    page.write_text("mine")
    assert "report-A17.html: already exists" in palpate("report", "A17", status=2).err
    assert page.read_text() == "mine"
