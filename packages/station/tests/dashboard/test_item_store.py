"""The items of the store: stored grasps, bins and item pages."""

from __future__ import annotations

import csv
import logging
import math
import socket
import sqlite3
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from datetime import UTC, datetime
from logging.handlers import QueueHandler
from pathlib import Path
from queue import SimpleQueue
from types import MappingProxyType

import openpyxl
import pytest
from packages.station.tests.dashboard.test_live import SOURCE as PAGE_SOURCE

from palpate.errors import InputError
from palpate.grasp.document import GraspDocument, ItemFacts
from palpate.grasp.estimator import Observation
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.measurement import Measurement, Status
from palpate.recording import RecordingReader
from palpate.recording.replay import observations
from palpate_station.dashboard.audit import LOG
from palpate_station.dashboard.headline import why_default
from palpate_station.dashboard.item_store import ItemStore, StoreFault
from palpate_station.dashboard.messages import Grasped
from palpate_station.dashboard.panel_history import item_html, item_label
from palpate_station.dashboard.panel_html import day_text
from palpate_station.dashboard.words import Words
from palpate_station.line.epcis import epcis_document
from palpate_station.records import BIN_COLUMNS, About, Item, Source, Verdict
from palpate_station.sorting.conditions import OneOf, Within
from palpate_station.sorting.rules import Rule, RuleBook
from palpate_station.store import Store
from palpate_station.store import sender as store_sender
from palpate_station.store.export import export, find_bins
from palpate_station.store.item_history import AWAY_NOTE, item_document
from palpate_station.store.labels import add_label

RESULT = GraspResult(
    outcome=Outcome.HELD,
    stiffness_n_per_mm=Measurement(value=2.1, low=1.7, high=2.6, unit="n_per_mm"),
    firmness=Measurement(value=44.1, low=41.0, high=47.2, unit="index"),
    moments=(Moment(time_s=1.9, name="answer"),),
)

SOURCE = replace(PAGE_SOURCE, calibration="{}")


def place_and_add(
    item_store: ItemStore,
    document: GraspDocument,
    *,
    recording: Path | None = None,
    closing: Mapping[str, Measurement] = MappingProxyType({}),
) -> GraspDocument:
    """Decide on a measured object from the frames of its grasp, and store it at the end."""
    frames: list[Observation] = []
    if recording is not None:
        with RecordingReader(recording) as reader:
            pairs = list(observations(reader))
        frames = [Observation(frame=one, gripper=state) for one, state in pairs if state]
    grasped = Grasped(
        document=document, observations=tuple(frames), recording=recording, closing=closing
    )
    placement = item_store.place(grasped, item_id=document.item_id, source=SOURCE)
    return item_store.add(document, placement=placement, calibration=SOURCE.calibration)


WIDE = Measurement(value=60.5, low=60.0, high=61.1, unit="mm")


def test_item_store_saves_a_grasp_with_its_pixels_and_calibration(
    recorded: Path, tmp_path: Path
) -> None:
    where = str(tmp_path / "items.sqlite")
    item_store = ItemStore(where)
    assert item_store.pages(limit=50) == ()
    assert not Path(where).exists(), "a query must not create a store"
    closing = {"contact_mm": WIDE}
    named = GraspDocument(result=RESULT, item_id="berry-7")
    place_and_add(item_store, named, recording=recorded, closing=closing)
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


def test_bounds_are_stored_and_exported_but_are_no_values(tmp_path: Path) -> None:
    where = tmp_path / "items.sqlite"
    at_least = Measurement(value=None, low=1.59, high=40.0, unit="n_per_mm", status=Status.AT_LEAST)
    saturated = Measurement(value=None, low=12.0, high=math.inf, unit="n", status=Status.AT_LEAST)
    result = replace(RESULT, stiffness_n_per_mm=at_least, force_n=saturated)
    item_store = ItemStore(str(where))
    for stiffer in (RESULT, result):
        place_and_add(item_store, GraspDocument(result=stiffer, item_id="berry-7"))
    with sqlite3.connect(where) as connection:
        query = "SELECT value, low, high, status FROM measurements WHERE name = ? ORDER BY low"
        bound, measured = connection.execute(query, ("stiffness_n_per_mm",)).fetchall()
        (force,) = connection.execute(query, ("force_n",)).fetchall()
        (mean,) = connection.execute(
            "SELECT avg(value) FROM measurements WHERE name = 'stiffness_n_per_mm'"
        ).fetchone()
    connection.close()
    assert bound == (None, 1.59, 40.0, "at_least")
    assert force == (None, 12.0, None, "at_least")
    assert mean == measured[0] == 2.1
    page = item_store.page("berry-7")
    _, last = page.grasps
    shown = {name: last.measurements[name].to_dict() for name in ("stiffness_n_per_mm", "force_n")}
    assert [(one["value"], one["low"], one["high"]) for one in shown.values()] == [
        (None, 1.59, None),
        (None, 12.0, None),
    ]
    assert last.find_value("stiffness_n_per_mm") is None
    with Store.open(where) as store:
        export(tmp_path / "all.csv", store.grasps(), (), items=store.items(), bins={})
    with (tmp_path / "all.csv").open(newline="", encoding="utf-8") as file:
        row = list(csv.DictReader(file))[1]
    names = ("", "_low", "_high", "_status")
    assert [row[f"stiffness_n_per_mm{end}"] for end in names] == ["", "1.59", "", "at_least"]


def test_shared_store_that_does_not_answer_is_logged(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    told = SimpleQueue[logging.LogRecord]()
    handler = QueueHandler(told)
    LOG.addHandler(handler)
    item_store = ItemStore(f"postgresql://nobody@/items?host={tmp_path}")
    stored = place_and_add(item_store, GraspDocument(result=RESULT, item_id="berry-7"))
    assert stored.stored
    assert "the records wait in the local store" in told.get(timeout=60.0).getMessage()
    LOG.removeHandler(handler)
    # Clients get the refusal.
    with pytest.raises(InputError, match=r"^no item 'nobody'"):
        item_store.page("nobody")


def test_shared_store_that_hangs_delays_only_the_first_item(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    monkeypatch.setattr(store_sender, "_RETRY_S", 1e3)
    told = SimpleQueue[logging.LogRecord]()
    handler = QueueHandler(told)
    LOG.addHandler(handler)
    with socket.create_server(("127.0.0.1", 0), backlog=50) as silent:
        silent.setblocking(False)
        port = silent.getsockname()[1]
        item_store = ItemStore(f"postgresql://nobody@127.0.0.1:{port}/items", rules=RULES)
        place_and_add(item_store, GraspDocument(result=RESULT, item_id="berry-7"))
        told.get(timeout=60.0)
        accept_all(silent)
        for _ in range(2):
            place_and_add(item_store, GraspDocument(result=RESULT, item_id="berry-7"))
        page = item_store.page("berry-7")
        assert len(page.grasps) == 3
        # Neither what is stored nor what a screen shows contains the address or the error.
        assert item_document(page)["away"] == AWAY_NOTE
        explanation = page.latest_verdict(About.BIN).explanation
        assert AWAY_NOTE in explanation
        assert str(port) not in explanation
        # A label waits for the store as little as a grasp does.
        began_s = time.monotonic()
        item_store.change(Item(item_id="berry-7"), labels={"bruise": "sound"}, by="maria")
        assert time.monotonic() - began_s < 4.0
        assert (item_store.shared_fault, item_store.waiting()) == (StoreFault.AWAY, 8)
        # Each grasp lets the sender try again.
        assert accept_all(silent) <= 2
    LOG.removeHandler(handler)


def accept_all(silent: socket.socket) -> int:
    """Close the waiting connections; return their number."""
    count = 0
    with suppress(BlockingIOError):
        while True:
            silent.accept()[0].close()
            count += 1
    return count


def test_item_html_shows_figure_and_simulated_label_and_escapes_the_name(
    recorded: Path, tmp_path: Path
) -> None:
    item_store = ItemStore(str(tmp_path / "items.sqlite"))
    for _ in range(3):
        document = GraspDocument(result=RESULT, item_id="<b>berry</b>")
        place_and_add(item_store, document, recording=recorded)
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
    given = place_and_add(item_store, document).bin
    assert (None if given is None else (given.name, given.rule)) == found
    unsorted = place_and_add(ItemStore(None), document).to_dict()
    assert unsorted == document.to_dict() | {"stored": False, "not_stored": "no item"}


def test_export_has_the_bin_of_each_grasp_as_shown_and_published(tmp_path: Path) -> None:
    where = tmp_path / "items.sqlite"
    item_store = ItemStore(str(where), rules=replace(RULES, most_grasps=2))
    shown = [place_and_add(item_store, sized(size, item_id="A1")) for size in (45.1, 40.0)]
    place_and_add(item_store, sized(40.0, item_id="A2"))
    place_and_add(item_store, sized(40.0, Outcome.SLIPPED, item_id="A3"))
    with Store.open(where) as store:
        add_label(store, "A2", about=About.BIN, text="large", by="maria")
        verdicts = store.verdicts(About.BIN)
        bins = find_bins(verdicts)
        export(tmp_path / "all.csv", store.grasps(), verdicts, items=store.items(), bins=bins)
        export(tmp_path / "all.xlsx", store.grasps(), verdicts, items=store.items(), bins=bins)
    chosen = [one.bin for one in shown if one.bin is not None]
    assert [one.again for one in chosen] == [True, False]
    expected = [[b.name, b.why, b.probability, b.again, "palpate"] for b in chosen]
    expected += [["large", None, None, None, "maria"], [None] * 5]
    book = openpyxl.load_workbook(tmp_path / "all.xlsx")
    head, *cells = book["grasps"].iter_rows(values_only=True)
    assert [[row[head.index(name)] for name in BIN_COLUMNS] for row in cells] == expected
    with (tmp_path / "all.csv").open(newline="", encoding="utf-8") as file:
        rows = [[row[name] for name in BIN_COLUMNS] for row in csv.DictReader(file)]
    assert rows == [["" if cell is None else str(cell) for cell in row] for row in expected]


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
    grasped = Grasped(document=document, recording=recorded)
    placement = item_store.place(grasped, item_id="A1", source=SOURCE)
    with Store.open(where) as store:
        # The decision made while the hand holds is the one that is stored.
        given_at = datetime(2026, 5, 2, tzinfo=UTC)
        late = Verdict(item_id="A1", about=About.RIPENESS, text="hard", given_at=given_at)
        store.add_verdict(late)
    placed = item_store.add(document, placement=placement, calibration="{}", batch="Monday")
    assert (placed.bin, placed.stored) == (placement.bin, True)
    assert placed.item == ItemFacts(id="A1", kind="avocado", stage="ripe", bruised=True)
    assert placed.bin is not None
    assert (placed.bin.name, placed.bin.rule) == ("ripe", 1)
    page = item_store.page("A1")
    assert (page.item.kind, page.item.batch) == ("avocado", "Monday")
    verdict = page.latest_verdict(About.BIN)
    assert (len(page.grasps), verdict.text) == (1, "ripe")
    # The bin of a grasp is also in its EPCIS event.
    (event,) = epcis_document(page, created_at=verdict.given_at)["epcisBody"]["eventList"]
    reports = event["sensorElementList"][0]["sensorReport"]
    assert {"type": "palpate:bin", "stringValue": "ripe"} in reports


def test_item_that_is_measured_again_is_known_with_its_bin_and_batch(tmp_path: Path) -> None:
    where = str(tmp_path / "items.sqlite")
    item_store = ItemStore(where, rules=replace(RULES, most_grasps=2))
    with Store.open(where) as store:
        # A batch is no news before the first grasp.
        store.add_item(Item(item_id="A1", batch="delivery"))
    found = []
    for size_mm in (45.1, 40.0, 44.0):
        document = sized(size_mm, item_id="A1")
        placement = item_store.place(Grasped(document=document), item_id="A1", source=SOURCE)
        found.append((placement.batch, placement.sorted_as))
        item_store.add(document, placement=placement, calibration="{}", batch="Monday")
    assert found == [(None, ""), ("Monday", ""), ("Monday", placement.sorted_as)]
    # A provisional bin is none.
    assert placement.sorted_as in RULES.bins
    assert f"already sorted: {placement.sorted_as}" in placement.bin.why


def test_default_bin_has_the_closest_rule_as_its_reason(tmp_path: Path) -> None:
    rules = replace(RULES, rules=RULES.rules[1:])
    item_store = ItemStore(str(tmp_path / "items.sqlite"), rules=rules)
    reasons = []
    for size_mm in (45.0, 60.0, 40.0):
        placed = Grasped(document=sized(size_mm))
        placement = item_store.place(placed, item_id="A1", source=SOURCE)
        reasons.append(why_default(placement, Words()))
    assert reasons == ["not certain: small 50 %, 80 % required", "no rule matches", ""]


@pytest.mark.parametrize(
    ("label", "words"),
    [
        ({"ripeness": "rype"}, "hard, conditioned, ripe, overripe, breaker"),
        ({"bruise": "brused"}, "bruised, sound"),
        ({"identity": "kiwi", "bin": "smal"}, "green, small, by hand"),
    ],
)
def test_label_with_an_unknown_word_is_refused_with_the_known_ones_and_stores_nothing(
    tmp_path: Path, label: dict[str, str], words: str
) -> None:
    own = Rule(bin="green", conditions=(OneOf("ripeness", frozenset({"breaker"})),), line=1)
    rules = replace(RULES, rules=(own, RULES.rules[1]))
    item_store = ItemStore(str(tmp_path / "items.sqlite"), rules=rules)
    with pytest.raises(InputError, match=f"must be one of {words}$"):
        item_store.change(Item(item_id="A1"), labels=label, by="maria")
    assert item_store.pages(limit=1) == ()
    known = {"ripeness": "breaker", "bruise": "sound", "identity": "any name", "bin": "by hand"}
    page = item_store.change(Item(item_id="A1"), labels=known, by="maria")
    assert {str(one.about): one.text for one in page.verdicts} == known
    # Without rules every bin is possible.
    unsorted = ItemStore(str(tmp_path / "items.sqlite"))
    assert unsorted.change(Item(item_id="A1"), labels={"bin": "smal"}, by="maria").verdicts


@pytest.mark.parametrize("is_labelled", [False, True])
def test_rule_on_a_class_without_labels_gives_the_default_bin_and_the_reason(
    tmp_path: Path, is_labelled: bool
) -> None:
    avocado = Rule(bin="export", conditions=(OneOf("class", frozenset({"avocado"})),), line=3)
    book = RuleBook(rules=(avocado, *RULES.rules), default_bin="by hand", most_grasps=3)
    where = str(tmp_path / "items.sqlite")
    if is_labelled:
        with Store.open(where) as store:
            store.add_item(Item(item_id="A0", kind="avocado"))
    item_store = ItemStore(where, rules=book)
    placed = place_and_add(item_store, sized(60.0, item_id="A1"))
    assert placed.bin is not None
    assert (placed.bin.name, placed.bin.again, placed.no_bin) == ("by hand", False, "")
    assert "class unknown: " in placed.bin.why
    # The store works, so the station is healthy.
    assert item_store.trouble == ""
    # The other rules, and kinds that a person has stated, still decide.
    small = place_and_add(item_store, sized(40.0, item_id="A2")).bin
    assert small is not None
    assert small.name == "small"
    if is_labelled:
        stated = place_and_add(item_store, sized(60.0, item_id="A0")).bin
        assert stated is not None
        assert stated.name == "export"


def test_sort_grasp_with_an_unusable_store_returns_no_bin_and_the_reason(
    recorded: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    broken = tmp_path / "broken.sqlite"
    broken.write_text("this is not a database" * 100)
    item_store = ItemStore(str(broken), rules=RULES)
    placed = place_and_add(item_store, sized(40.0, item_id="A1"), recording=recorded)
    assert (placed.is_sorted, placed.bin, placed.item) == (True, None, ItemFacts(id="A1"))
    assert (placed.no_bin, placed.not_stored) == (StoreFault.UNUSABLE, StoreFault.UNUSABLE)
    # Screens show a few words; the log has the file.
    assert str(broken) in caplog.text
