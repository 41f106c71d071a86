"""`palpate items` and `palpate grasp --item`."""

from __future__ import annotations

import csv
import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from datetime import timedelta
from pathlib import Path

import openpyxl
import pyarrow.parquet as pq
import pytest
from packages.station.tests.cli.stored import stored_grasp
from packages.station.tests.factories import NOON
from tests.commands import Command

from palpate_station.records import About, Grasp, Item, Verdict
from palpate_station.store import Store, engine

pytestmark = pytest.mark.usefixtures("folder")

#: The rate of the paper's board: a simulated grasp then costs a third.
SEED = ("--seed", "1", "--rate-hz", "15")


def grasp(item_id: str, *, days: int = 0, **values: float) -> Grasp:
    return stored_grasp(
        item_id,
        {"stiffness_n_per_mm": 3.0} | values,
        hours=24 * days,
        rig="hall.toml",
        origin="hardware" if item_id != "S1" else "twin",
        pixel_settled_percent=((-40.0, None), (-42.0, -41.0)),
        angle_deg=90.0,
    )


@pytest.fixture
def filled(folder: Path) -> None:
    with Store.open() as store:
        store.add_item(Item(item_id="A17", kind="avocado", batch="Monday", first_seen=NOON))
        store.add_item(Item(item_id="K2", kind="kiwi", first_seen=NOON + timedelta(days=1)))
        store.add_grasps(
            [grasp("A17"), grasp("A17", days=2, stiffness_n_per_mm=2.25), grasp("K2", days=1)]
        )
        store.add_verdict(
            Verdict(
                item_id="A17",
                about=About.RIPENESS,
                text="ripe",
                probability=0.91,
                given_at=NOON,
                explanation="a quarter softer than on Friday",
            )
        )


@pytest.mark.slow
def test_grasp_of_an_item_is_stored_with_its_calibration(palpate: Command) -> None:
    document = palpate("grasp", "--item", "A17", "--angle-deg", "90", *SEED, "--json").document
    with Store.open(create=False) as store:
        (stored,) = store.grasps_of("A17")
        assert "palpate-calibration" in store.calibration(stored.calibration_id or "")
    assert stored.grasp_id == document["grasp_id"]
    assert stored.origin == "twin"
    assert stored.angle_deg == 90.0
    for name in ("size_mm", "force_n", "stiffness_n_per_mm", "settled_percent"):
        # The reason of a bound is only in the result.
        assert stored.measurements[name].to_dict() == document[name] | {"reason": None}


@pytest.mark.slow
def test_grasp_with_unreachable_shared_store_is_stored_locally(
    palpate: Command, folder: Path
) -> None:
    nowhere = f"postgresql://palpate@/items?host={folder}"
    out, err = palpate("grasp", "--item", "A17", "--store", nowhere, *SEED, "--json")
    assert json.loads(out)["item_id"] == "A17"
    assert "no answer; check the server" in err
    assert "has the records, and the next command sends them" in err
    out, err = palpate("items", "A17", "--store", nowhere, "--json")
    assert len(json.loads(out)["grasps"]) == 1
    assert "no answer; check the server" in err
    assert "without data of other stations" in err


@pytest.mark.slow
def test_grasp_prints_the_result_before_contacting_the_store(
    palpate: Command, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    def press_ctrl_c(self: Store, grasp: Grasp, *, calibration: str) -> None:
        shown.append(capsys.readouterr().out)
        raise KeyboardInterrupt

    monkeypatch.setattr(Store, "add_grasp", press_ctrl_c)
    palpate("grasp", "--item", "A17", *SEED, status=130)
    assert "SIMULATED" in shown[0].upper()


@pytest.mark.slow
def test_grasp_local_store_failure_exits_with_3(
    palpate: Command, monkeypatch: pytest.MonkeyPatch, folder: Path
) -> None:
    monkeypatch.setattr(engine, "LOCK_TIMEOUT_S", 0.05)
    Store.open().close()
    with closing(sqlite3.connect(folder / "palpate-items.sqlite", isolation_level=None)) as other:
        other.execute("BEGIN IMMEDIATE")
        out, err = palpate("grasp", "--item", "A17", *SEED, "--json", status=3)
    assert json.loads(out)["item_id"] == "A17"
    assert "locked by another program" in err
    assert "the grasp is NOT stored" in err


@pytest.mark.usefixtures("filled")
def test_items_list_and_page_show_grasps_and_verdicts(palpate: Command) -> None:
    out = palpate("items").out
    assert out.index("K2") < out.index("A17"), "the latest grasped item is first"
    assert "2.25" in out
    assert "simulated" not in out
    assert "--limit shows more" in palpate("items", "--limit", "1").out
    for filters in (("--kind", "avocado"), ("--batch", "Monday"), ("--day", "2026-05-03")):
        (line,) = palpate("items", "--json", *filters).document["items"]
        assert (line["item_id"], line["grasps"]) == ("A17", 2)
        assert line["last_taken_at"] == "2026-05-03T12:00:00+00:00"
        assert line["stiffness_n_per_mm"]["value"] == 2.25
        assert line["verdicts"]["ripeness"]["text"] == "ripe"
        assert line["verdicts"]["bruise"] is None
    out = palpate("items", "A17").out
    for words in ("batch Monday", "3.00", "2.00…4.00", "90°", "91 %", "a quarter softer"):
        assert words in out
    page = palpate("items", "A17", "--json").document
    assert page["grasps"][0]["pixel_settled_percent"] == [[-40.0, None], [-42.0, -41.0]]
    assert page["verdicts"][0]["text"] == "ripe"


def test_items_page_ranks_firmness_within_the_kind_and_labels_simulated_items(
    palpate: Command,
) -> None:
    with Store.open() as store:
        for number, index in enumerate([65.0, *range(10, 90, 10)]):
            name = f"A{number}"
            store.add_item(Item(item_id=name, kind="avocado"))
            store.add_grasp(grasp(name, firmness=index))
        store.add_grasps([grasp("A1", days=1), grasp("S1")])
    found = palpate("items", "A0", "--json").document
    assert found["firmness_rank"] == {"items": 8, "softer": 0.75}
    shown = palpate("items", "A0").out
    assert "firmer than 75 % of 8 items of its kind" in shown
    assert "SIMULATED" not in shown
    assert "simulated on the twin" in palpate("items").out
    assert "SIMULATED" in palpate("items", "S1").out


@pytest.mark.usefixtures("filled")
def test_items_export_writes_every_grasp_with_its_item(palpate: Command, folder: Path) -> None:
    assert "all.parquet (grasps: 3)" in palpate("items", "--export", "all.parquet").err
    table = pq.read_table(folder / "all.parquet")
    assert table["item_id"].to_pylist() == ["A17", "A17", "K2"]
    assert table["kind"].to_pylist() == ["avocado", "avocado", "kiwi"]
    assert table["stiffness_n_per_mm"].to_pylist() == [3.0, 2.25, 3.0]
    assert table["stiffness_n_per_mm_low"].to_pylist() == [2.0, 1.25, 2.0]
    assert table["size_mm"].to_pylist() == [None] * 3
    assert table["taken_at"].to_pylist()[0] == NOON
    assert table["pixel_settled_percent"].to_pylist()[0] == [[-40.0, None], [-42.0, -41.0]]
    verdicts = pq.read_table(folder / "all.verdicts.parquet")
    assert verdicts["text"].to_pylist() == ["ripe"]

    palpate("items", "--kind", "kiwi", "--export", "kiwi.parquet")
    assert pq.read_table(folder / "kiwi.parquet").num_rows == 1
    assert pq.read_table(folder / "kiwi.verdicts.parquet").num_rows == 0
    palpate("items", "A17", "--export", "a17.parquet")
    assert pq.read_table(folder / "a17.parquet").num_rows == 2


@pytest.mark.usefixtures("filled")
def test_export_to_csv_and_excel_has_the_same_rows_and_no_formulas(
    folder: Path, palpate: Command
) -> None:
    with Store.open() as store:
        store.add_item(Item(item_id="A17", batch="=1+1"))
        store.add_grasps([replace(grasp("K2", days=3), station="line 1")])
    palpate("items", "--export", "all.csv")
    palpate("items", "--export", "all.xlsx")
    with (folder / "all.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["item_id"] for row in rows] == ["A17", "A17", "K2", "K2"]
    assert [row["station"] for row in rows] == ["", "", "", "line 1"]
    assert [float(row["stiffness_n_per_mm"]) for row in rows] == [3.0, 2.25, 3.0, 3.0]
    assert rows[0]["batch"] == "'=1+1"
    assert json.loads(rows[0]["pixel_settled_percent"]) == [[-40.0, None], [-42.0, -41.0]]
    with (folder / "all.verdicts.csv").open(newline="", encoding="utf-8") as file:
        assert [row["text"] for row in csv.DictReader(file)] == ["ripe"]
    book = openpyxl.load_workbook(folder / "all.xlsx", read_only=True)
    head, *cells = book["grasps"].iter_rows(values_only=True)
    item = head.index("item_id")
    assert [row[item] for row in cells] == [row["item_id"] for row in rows]
    assert cells[0][head.index("stiffness_n_per_mm")] == 3.0
    assert len(list(book["verdicts"].iter_rows())) == 2
    book.close()
    assert ".xlsx" in palpate.refused("items", "--export", "all.ods")


@pytest.mark.usefixtures("filled")
@pytest.mark.parametrize(
    ("selected", "near"),
    [
        (("--batch", "Mondey"), "did you mean: Monday?"),
        (("--kind", "avocadoo"), "did you mean: avocado?"),
        (("--kind", "kiwi", "--batch", "Monday"), "no items of kind kiwi in batch Monday"),
    ],
)
def test_a_selection_without_items_is_refused_and_writes_no_file(
    palpate: Command, selected: tuple[str, ...], near: str
) -> None:
    for wanted in (("--export", "none.csv"), ()):
        assert near in palpate.refused("items", *selected, *wanted)
    assert not Path("none.csv").exists()


def test_items_refuses_a_bin_that_neither_the_store_nor_the_rules_have(
    palpate: Command, filled: None, folder: Path
) -> None:
    # Nothing is known of the bins before the first one.
    palpate("items", "K2", "--say", "bin=large", "--by", "maria")
    said = ("items", "A17", "--say", "bin=lareg")
    assert "no such bin; known are large." in palpate(*said, status=2).err
    rules = '[[rule]]\nbin = "lareg"\nsize_mm = [0, 60]\n'
    (folder / "rules.toml").write_text(f'default = "by hand"\n{rules}')
    palpate(*said, "--rules", "rules.toml")
    with Store.open() as store:
        found = {one.text: one.giver for one in store.verdicts(About.BIN)}
    assert found["large"] == "maria"
    assert set(found) == {"large", "lareg"}
