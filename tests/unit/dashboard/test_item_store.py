"""The items of the store: stored grasps, bins and item pages."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest
from tests.factories import make_grasp
from tests.unit.dashboard.test_live import SOURCE as PAGE_SOURCE

from palpate.dashboard.item_store import ItemStore
from palpate.dashboard.panel_history import item_html, item_label
from palpate.dashboard.panel_html import day_text
from palpate.estimate.firmness import firmness_index
from palpate.grasp.document import GraspDocument, ItemFacts
from palpate.grasp.result import GraspResult, Moment, Outcome
from palpate.line.epcis import epcis_document
from palpate.measurement import Measurement, Status
from palpate.produce.records import About, Grasp, Item, Source, Verdict
from palpate.produce.sorting.conditions import OneOf, Within
from palpate.produce.sorting.rules import Rule, RuleBook
from palpate.produce.store import Store
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.world import World

RESULT = GraspResult(
    outcome=Outcome.HELD,
    stiffness_n_per_mm=Measurement(value=2.1, low=1.7, high=2.6, unit="n_per_mm"),
    firmness=Measurement(value=44.1, low=41.0, high=47.2, unit="index"),
    moments=(Moment(time_s=1.9, name="answer"),),
)

SOURCE = replace(PAGE_SOURCE, calibration="{}")
WIDE = Measurement(value=60.5, low=60.0, high=61.1, unit="mm")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    world = World(None, seed=1)
    array, gripper = TwinArray(world), TwinGripper(world)
    file = tmp_path / "grasp.mcap"
    info = RecordingInfo(
        layout=array.layout,
        origin="twin",
        rig="sim-rigid",
        calibration="{}",
        gripper=gripper.limits,
    )
    with RecordingWriter(file, info=info) as writer:
        for _ in range(30):
            frame = array.read(timeout_s=1.0)
            writer.add_observation(frame, gripper=gripper.state())
    return file


def test_item_store_saves_a_grasp_with_its_pixels_and_calibration(
    recording: Path, tmp_path: Path
) -> None:
    where = str(tmp_path / "items.sqlite")
    item_store = ItemStore(where)
    assert item_store.pages(limit=50) == ()
    assert not Path(where).exists(), "a query must not create a store"
    closing = {"contact_mm": WIDE}
    item_store.sort_grasp(
        GraspDocument(result=RESULT, item_id="berry-7"),
        source=SOURCE,
        recording=recording,
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
    assert grasp.recording == str(recording.resolve())
    assert grasp.pixel_settled_percent is not None
    assert len(grasp.pixel_settled_percent) == 4


def test_item_html_shows_figure_and_simulated_label_and_escapes_the_name(
    recording: Path, tmp_path: Path
) -> None:
    item_store = ItemStore(str(tmp_path / "items.sqlite"))
    for _ in range(3):
        document = GraspDocument(result=RESULT, item_id="<b>berry</b>")
        item_store.sort_grasp(document, source=SOURCE, recording=recording)
    found = item_store.page("<b>berry</b>")
    page = item_html(found, figures=item_store.figures_html(found))
    assert 'aria-label="Firmness over time"' in page
    assert "firmness 44 of 100" in page
    assert "SIMULATED" in page
    assert "&lt;b&gt;berry&lt;/b&gt;" in page
    assert "<b>berry" not in page


@pytest.mark.slow
def test_item_figures_omit_firmness_known_only_as_a_bound(recording: Path, tmp_path: Path) -> None:
    bound = Measurement(
        value=None, low=36.0, high=97.0, unit="index", status=Status.AT_LEAST, reason="soft hand"
    )
    settled = Measurement(value=-30.0, low=-32.0, high=-28.0, unit="percent")
    result = replace(RESULT, firmness=bound, settled_percent=settled)
    item_store = ItemStore(str(tmp_path / "items.sqlite"))
    for _ in range(2):
        document = GraspDocument(result=result, item_id="berry-7")
        item_store.sort_grasp(document, source=SOURCE, recording=recording)
    figures = item_store.figures_html(item_store.page("berry-7"))
    assert 'aria-label="Settled change over time"' in figures
    assert "Firmness over time" not in figures


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
    recording: Path, tmp_path: Path
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
    placed = item_store.sort_grasp(document, source=SOURCE, recording=recording)
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
    recording: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.sqlite"
    broken.write_text("this is not a database" * 100)
    item_store = ItemStore(str(broken), rules=RULES)
    placed = item_store.sort_grasp(sized(40.0, item_id="A1"), source=SOURCE, recording=recording)
    assert (placed.is_sorted, placed.bin, placed.item) == (True, None, ItemFacts(id="A1"))
    assert str(broken) in placed.no_bin
    assert str(broken) in item_store.trouble


@pytest.mark.slow
def test_item_figures_show_ripening_only_for_kinds_with_labelled_items(tmp_path: Path) -> None:
    where = str(tmp_path / "items.sqlite")
    stages = {"hard": 9.0, "conditioned": 5.0, "ripe": 2.5, "overripe": 1.2}
    with Store.open(where) as store:
        for number in range(6):
            name = f"avocado-{number}"
            store.add_item(Item(item_id=name, kind="avocado"))
            for day, (stage, firm) in enumerate(stages.items()):
                taken = datetime(2026, 5, 1 + day, 8, number, tzinfo=UTC)
                store.add_grasp(grasp_with_stiffness(name, taken, firm * (1 + 0.03 * number)))
                label = Verdict(item_id=name, given_at=taken, about=About.RIPENESS, text=stage)
                store.add_verdict(replace(label, source=Source.PERSON))
        store.add_item(Item(item_id="plum", kind="plum"))
    item_store = ItemStore(where)
    picture = item_store.figures_html(item_store.page("avocado-1"))
    assert "<h3>Ripening</h3><svg" in picture
    assert 'aria-label="Ripening of avocado-1 with its forecast"' in picture
    assert "90 % of courses" in picture
    assert "<h3>Ripening</h3>" not in item_store.figures_html(item_store.page("plum"))


def grasp_with_stiffness(item_id: str, taken_at: datetime, firm: float) -> Grasp:
    """Return a grasp with a stiffness measured at 5 N."""
    measured = Measurement(value=firm, low=0.8 * firm, high=1.25 * firm, unit="n_per_mm")
    measurements = {
        "firmness": firmness_index(measured),
        "force_n": Measurement(value=5.0, low=4.5, high=5.5, unit="n"),
        "stiffness_n_per_mm": measured,
    }
    return make_grasp(item_id, taken_at=taken_at, outcome="held", measurements=measurements)
