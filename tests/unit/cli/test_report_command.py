"""`palpate report`: a self-contained page about items of the store."""

from __future__ import annotations

import re
from collections.abc import Callable
from datetime import timedelta
from html.parser import HTMLParser
from pathlib import Path

import pytest
from tests.commands import Command
from tests.factories import NOON, make_grasp

from palpate.estimate.measurement import Measurement
from palpate.grasp.result import Outcome
from palpate.produce.records import MEASURED, About, Grasp, Item, Source, Verdict
from palpate.produce.store import Store
from palpate.settling.result import Status

VALUES = {"size_mm": 62.5, "force_n": 2.5, "stiffness_n_per_mm": 4.25, "settled_percent": -31.0}
VOID = {"meta", "br", "img", "link"}


class Checker(HTMLParser):
    """Checks that elements are closed in order; collects references to other files."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in ("src", "href") or (name == "xlink:href" and not str(value).startswith("#")):
                self.references.append(f"{tag} {name}={value}")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PALPATE_STORE", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path


@pytest.fixture
def store() -> None:
    with Store.open() as store:
        for number, kind in enumerate(["avocado", "avocado", "<kiwi> & co"]):
            name = f"i{number}"
            store.add_item(Item(item_id=name, kind=kind, batch="Monday", first_seen=NOON))
            for day in range(3):
                store.add_grasp(grasp(name, hours=24 * day + number))
            verdict = Verdict(
                item_id=name,
                about=About.RIPENESS,
                text="ripe" if number else "hard",
                probability=0.875,
                given_at=NOON,
                explanation="1.5 < 2 N/mm",
            )
            store.add_verdict(verdict)
            label = Verdict(
                item_id=name,
                about=About.RIPENESS,
                text="ripe",
                given_at=NOON + timedelta(hours=5),
                source=Source.PERSON,
            )
            store.add_verdict(label)


def grasp(item_id: str, *, hours: float, outcome: Outcome = Outcome.HELD) -> Grasp:
    return make_grasp(
        item_id,
        taken_at=NOON + timedelta(hours=hours),
        outcome=outcome if hours else Outcome.SLIPPED,
        measurements={
            name: Measurement(
                value=value - hours / 100,
                low=value - 1,
                high=value + 1,
                unit=MEASURED[name],
                status=Status.OK if hours else Status.SATURATED,
            )
            for name, value in VALUES.items()
        },
        pixel_settled_percent=((-31.0, -30.0), (None, -45.0)),
        angle_deg=90.0,
    )


@pytest.fixture
def report(palpate: Command) -> Callable[..., str]:
    """Return a function that writes a report and returns its HTML."""

    def write(*arguments: str) -> str:
        assert "Written: page.html" in palpate("report", *arguments, "--out", "page.html").err
        return Path("page.html").read_text(encoding="utf-8")

    return write


def check_page(page: str) -> Checker:
    checker = Checker()
    checker.feed(page)
    assert checker.open == []
    # The page requires no other file: no script, font or picture.
    assert checker.references == []
    assert "script" not in checker.tags
    assert not re.search(r"url\((?!#)|@import", page)
    return checker


@pytest.mark.usefixtures("store")
def test_report_of_an_item_shows_its_grasps(report: Callable[..., str]) -> None:
    page = report("i0")
    assert check_page(page).tags.count("svg") == 4
    for words in (
        "simulated on the twin",
        "batch Monday",
        "3 grasps",
        "3.77",
        "given by a person",
        "1.5 &lt; 2 N/mm",
        "62.0",
        "90°",
        "slipped",
    ):
        assert words in page


@pytest.mark.usefixtures("store")
def test_report_of_a_batch_shows_its_items(report: Callable[..., str]) -> None:
    page = report("--batch", "Monday")
    assert "Softening" in page
    assert "&lt;kiwi&gt; &amp; co" in page
    assert "<kiwi>" not in page
    tags = check_page(page).tags
    assert tags.count("svg") == 3
    assert tags.count("tr") == 1 + 3


@pytest.mark.usefixtures("store")
def test_report_of_a_judged_batch_shows_ordered_stages_and_days_to_ripe(
    report: Callable[..., str],
) -> None:
    days = {"days_to_ripe": 1.25, "days_to_ripe_low": 0.0, "days_to_ripe_high": 2.5}
    stages = {"hard": 0.1, "ripe": 0.1, "overripe": 0.8}
    with Store.open() as store:
        for name, stage in (("i0", "overripe"), ("i1", "overripe"), ("i2", "hard")):
            judged = Verdict(
                item_id=name,
                about=About.RIPENESS,
                text=stage,
                given_at=NOON + timedelta(hours=9),
                details={"probabilities": stages} | (days if name == "i2" else {}),
            )
            store.add_verdict(judged)
    page = report("--batch", "Monday")
    assert "1.2 (now to 2.5)" in page
    bars = page[page.index("Ripeness") :]
    assert bars.index("hard") < bars.index("overripe")


@pytest.mark.usefixtures("store")
def test_report_of_a_day_contains_only_that_days_grasps(report: Callable[..., str]) -> None:
    page = report("--day", f"{NOON.astimezone():%Y-%m-%d}")
    assert "Grasps over the day" in page
    assert "4.25 *" in page
    assert "3.77" not in page
    assert "Softening" not in page
    check_page(page)


@pytest.mark.slow
@pytest.mark.usefixtures("store")
def test_report_styles_cover_light_dark_and_print(report: Callable[..., str]) -> None:
    page = report("i0")
    assert "prefers-color-scheme:dark" in page
    assert "@media print" in page
    # In figures, only elements on a fixed background have colours that do not depend on the scheme.
    drawn = page[page.index("<svg") : page.rindex("</svg>")]
    assert "#222222" not in drawn
    assert "var(--ink)" in drawn
    assert "DejaVu" not in drawn


def test_report_of_an_item_without_grasps_is_written(report: Callable[..., str]) -> None:
    with Store.open() as store:
        store.add_item(Item(item_id="new"))
    page = report("new")
    assert "0 grasps" in page
    check_page(page)


def test_report_file_is_named_after_its_item_or_batch(palpate: Command) -> None:
    names = ("A17", "A/17 (left)", "A 17 (left)")
    with Store.open() as store:
        for name in names:
            store.add_item(Item(item_id=name))
    for name in names:
        palpate("report", name)
    assert Path("report-A17.html").exists()
    assert len(list(Path().glob("report-A-17-left-*.html"))) == 2


@pytest.mark.usefixtures("store")
def test_report_does_not_overwrite_an_existing_file(palpate: Command) -> None:
    page = Path("report-i0.html")
    page.write_text("mine")
    assert "report-i0.html: already exists" in palpate("report", "i0", status=2).err
    assert page.read_text() == "mine"


@pytest.mark.usefixtures("store")
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give exactly one of ITEM, --batch NAME or --day DATE"),
        (("i0", "--batch", "Monday"), "give exactly one of"),
        (("i9",), "no item 'i9'"),
        (("--batch", "Tuesday"), "has no items of this batch"),
        (("--day", "2020-01-01"), "no grasps on 2020-01-01"),
        (("--day", "May"), "--day May: not a date"),
        (("i0", "--out", "no/page.html"), "the folder no does not exist; create it first"),
    ],
)
def test_report_invalid_input_is_refused_in_one_line(
    palpate: Command, arguments: tuple[str, ...], message: str
) -> None:
    assert message in palpate.refused("report", *arguments)
