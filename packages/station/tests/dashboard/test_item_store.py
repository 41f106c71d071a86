"""The items of the store: stored grasps, bins and item pages."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from packages.station.tests.dashboard.test_live import SOURCE as PAGE_SOURCE

from palpate.grasp.document import GraspDocument, ItemFacts
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.measurement import Measurement
from palpate_station.dashboard.item_store import ItemStore
from palpate_station.dashboard.panel_history import item_html, item_label
from palpate_station.dashboard.panel_html import day_text
from palpate_station.line.epcis import epcis_document
from palpate_station.records import About, Item, Source, Verdict
from palpate_station.sorting.conditions import OneOf, Within
from palpate_station.sorting.rules import Rule, RuleBook
from palpate_station.store import Store

RESULT = GraspResult(
    outcome=Outcome.HELD,
    stiffness_n_per_mm=Measurement(value=2.1, low=1.7, high=2.6, unit="n_per_mm"),
    firmness=Measurement(value=44.1, low=41.0, high=47.2, unit="index"),
    moments=(Moment(time_s=1.9, name="answer"),),
)

SOURCE = replace(PAGE_SOURCE, calibration="{}")
WIDE = Measurement(value=60.5, low=60.0, high=61.1, unit="mm")


def test_item_store_saves_a_grasp_with_its_pixels_and_calibration(
    recorded: Path, tmp_path: Path
) -> None:
    where = str(tmp_path / "items.sqlite")
    item_store = ItemStore(where)
    assert item_store.pages(limit=50) == ()
    assert not Path(where).exists(), "a query must not create a store"
    closing = {"contact_mm": WIDE}
    item_store.sort_grasp(
        GraspDocument(result=RESULT, item_id="berry-7"),
        source=SOURCE,
        recording=recorded,
        closing=closing,
    )
    assert item_store.trouble == ""
    (page,) = item_store.pages(limit=50)
    last = page.grasps[-1].taken_at
    assert item_label(page) == f"berry-7 · {day_text(last)}"
    ripe = Verdict(
        item_id="berry-7", given_at=last, about=About.RIPENESS, text="ripe", source=Source.PERSON
    )
    labelled = replace(page, item=replace(page.item, kind="kiwi"), verdicts=(ripe,))
    assert item_label(labelled) == f"berry-7 · kiwi · ripe · {day_text(last)}"
    with Store.open(where) as store:
        (grasp,) = store.grasps_of("berry-7")
        assert store.calibration(grasp.calibration_id or "") == "{}"
    assert grasp.measurements["contact_mm"].value == WIDE.value
    assert (grasp.rig, grasp.origin, grasp.drive) == ("sim-rigid", "twin", "width")
    assert grasp.recording == str(recorded.resolve())
    assert grasp.pixel_settled_percent is not None
    assert len(grasp.pixel_settled_percent) == 4


def test_item_html_shows_figure_and_simulated_label_and_escapes_the_name(
    recorded: Path, tmp_path: Path
) -> None:
    item_store = ItemStore(str(tmp_path / "items.sqlite"))
    for _ in range(3):
        document = GraspDocument(result=RESULT, item_id="<b>berry</b>")
        item_store.sort_grasp(document, source=SOURCE, recording=recorded)
    found = item_store.page("<b>berry</b>")
    page = item_html(found, figures=item_store.figures_html(found))
    assert 'aria-label="Firmness over time"' in page
    assert "firmness 44 of 100" in page
    assert "SIMULATED" in page
    assert "&lt;b&gt;berry&lt;/b&gt;" in page
    assert "<b>berry" not in page


RULES = RuleBook(
    rules=(
        Rule(bin="ripe", conditions=(OneOf("ripeness", frozenset({"ripe"})),), line=1),
        Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=2),
    ),
    default_bin="by hand",
    most_grasps=1,
)


def sized(size_mm: float, outcome: Outcome = Outcome.HELD, *, item_id: str = "") -> GraspDocument:
    size = Measurement(value=size_mm, low=size_mm - 0.5, high=size_mm + 0.5, unit="mm")
    return GraspDocument(result=GraspResult(outcome=outcome, size_mm=size), item_id=item_id)


@pytest.mark.parametrize(
    ("document", "found"),
    [
        (sized(40.0), ("small", 2)),
        (sized(60.0), ("by hand", None)),
        (sized(40.0, Outcome.SLIPPED), None),
    ],
)
def test_sort_grasp_of_an_unnamed_item_uses_this_grasp_only(
    tmp_path: Path, document: GraspDocument, found: tuple[str, int | None] | None
) -> None:
    item_store = ItemStore(str(tmp_path / "items.sqlite"), rules=RULES)
    given = item_store.sort_grasp(document, source=SOURCE).bin
    assert (None if given is None else (given.name, given.rule)) == found
    unsorted = ItemStore(None).sort_grasp(document, source=SOURCE).to_dict()
    assert unsorted == document.to_dict() | {"stored": False, "not_stored": "no item"}


def test_sort_grasp_uses_all_grasps_of_the_item_and_stores_the_bin(
    recorded: Path, tmp_path: Path
) -> None:
    where = str(tmp_path / "items.sqlite")
    with Store.open(where) as store:
        store.add_item(Item(item_id="A1", kind="avocado"))
        for about, text in ((About.RIPENESS, "ripe"), (About.BRUISE, "bruised")):
            given_at = datetime(2026, 5, 1, tzinfo=UTC)
            store.add_verdict(Verdict(item_id="A1", about=about, text=text, given_at=given_at))
    item_store = ItemStore(where, rules=RULES)
    document = sized(60.0, item_id="A1")
    before = item_store.sort_grasp(document, source=SOURCE)
    placed = item_store.sort_grasp(document, source=SOURCE, recording=recorded)
    assert placed == replace(before, stored=True)
    assert placed.item == ItemFacts(id="A1", kind="avocado", stage="ripe", bruised=True)
    assert placed.bin is not None
    assert (placed.bin.name, placed.bin.rule) == ("ripe", 1)
    page = item_store.page("A1")
    verdict = page.latest_verdict(About.BIN)
    assert (len(page.grasps), verdict.text) == (1, "ripe")
    # The bin of a grasp is also in its EPCIS event.
    (event,) = epcis_document(page, created_at=verdict.given_at)["epcisBody"]["eventList"]
    reports = event["sensorElementList"][0]["sensorReport"]
    assert {"type": "palpate:bin", "stringValue": "ripe"} in reports


def test_sort_grasp_with_an_unusable_store_returns_no_bin_and_the_reason(
    recorded: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.sqlite"
    broken.write_text("this is not a database" * 100)
    item_store = ItemStore(str(broken), rules=RULES)
    placed = item_store.sort_grasp(sized(40.0, item_id="A1"), source=SOURCE, recording=recorded)
    assert (placed.is_sorted, placed.bin, placed.item) == (True, None, ItemFacts(id="A1"))
    assert str(broken) in placed.no_bin
    assert str(broken) in item_store.trouble
