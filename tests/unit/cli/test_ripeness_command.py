"""`palpate ripeness` on the store of `palpate demo packhouse`."""

from __future__ import annotations

import json
import runpy
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from tests.commands import Command
from tests.pdf_fonts import check_fonts

from palpate.produce.records import About, Item, Source
from palpate.produce.store import Store

EXAMPLE = Path(__file__).resolve().parents[3] / "examples" / "batch_ripeness.py"


@pytest.fixture(scope="module")
def made(packhouse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(
        shutil.copy(packhouse / "palpate-items.sqlite", tmp_path_factory.mktemp("ripeness"))
    )


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    return tmp_path


@pytest.mark.slow
def test_ripeness_of_a_batch_has_one_row_per_item(made: Path, palpate: Command) -> None:
    batch = ("ripeness", "--batch", "Monday", "--store", made)
    items = palpate(*batch, "--json").document["items"]
    assert len(items) == 6
    assert all(item["simulated"] and item["basis"] == "labels" for item in items)
    for item in items:
        assert sum(item["probabilities"].values()) == pytest.approx(1.0)
        assert item["unsure"] == (max(item["probabilities"].values()) < 0.9)
        days = item["days_to_ripe"]
        assert days["low"] <= days["value"] <= days["high"]
        assert len(item["days"]) == 3
    # Ripest first, according to the twin; neighbouring stages may be confused.
    order = ["overripe", "ripe", "conditioned", "hard"]
    stages = [order.index(item["stage"]) for item in items]
    true = [0, 0, 1, 2, 3, 3]
    assert all(abs(a - b) <= 1 for a, b in zip(stages, true, strict=True))
    assert {"hard", "overripe"} <= {item["stage"] for item in items}
    named = [item["item_id"] for item in items if item["unsure"]]
    assert named
    output = " ".join(palpate(*batch).out.split())
    assert f"below 90 % probability: {', '.join(named)}; more grasps on the same day" in output


@pytest.mark.slow
def test_ripeness_of_one_item_is_explained_plotted_and_stored(
    made: Path, folder: Path, palpate: Command
) -> None:
    output = palpate("ripeness", "fruit-1", "--store", made, "--plot", "fruit.pdf").out
    assert "grasped 6 times on 3 days" in output
    assert "SIMULATED" in output
    check_fonts(folder / "fruit.pdf")
    with Store.open(made, create=False) as store:
        verdicts = store.verdicts_of("fruit-1", about=About.RIPENESS, source=Source.PALPATE)
    assert verdicts
    assert verdicts[-1].text in output


def test_ripeness_of_item_without_kind_uses_its_first_day(
    made: Path, tmp_path: Path, palpate: Command
) -> None:
    with Store.open(made, create=False) as store, Store.open(tmp_path / "one.sqlite") as other:
        other.add_item(Item(item_id="mine"))
        for grasp in store.grasps_of("fruit-1"):
            other.add_grasp(replace(grasp, item_id="mine", calibration_id=None))
    shown = palpate("ripeness", "mine", "--store", "one.sqlite", "--json")
    assert "judged relative to its first day, because its kind is unknown" in shown.err
    item = json.loads(shown.out)["items"][0]
    assert (item["basis"], item["days_to_ripe"]) == ("first day", None)
    # The stiffness has fallen by a third in two days, which leaves the stage uncertain.
    assert item["stage"] == max(item["probabilities"], key=item["probabilities"].get)
    assert item["unsure"]


def test_ripeness_assumed_from_first_day_is_not_stored(
    made: Path, tmp_path: Path, palpate: Command
) -> None:
    with Store.open(made, create=False) as store, Store.open(tmp_path / "new.sqlite") as other:
        other.add_item(Item(item_id="new"))
        first = store.grasps_of("fruit-1")[0]
        other.add_grasp(replace(first, item_id="new", calibration_id=None))
    output = palpate("ripeness", "new", "--store", "new.sqlite").out
    assert "assumed" in output
    assert "no earlier day to compare" in " ".join(output.split())
    with Store.open(tmp_path / "new.sqlite", create=False) as other:
        assert other.verdicts_of("new") == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "give an item or --batch NAME"),
        (("nobody",), "nobody"),
        (("fruit-1", "--stages", "ripe"), "at least two different stages"),
        (
            ("fruit-1", "--ripe", "green"),
            "must be a stage after the first: conditioned, ripe, overripe",
        ),
        (("fruit-1", "--plot", "fruit.bmp"), "a plot ends in .png"),
    ],
)
def test_ripeness_invalid_input_is_refused_in_one_line(
    arguments: tuple[str, ...], message: str, made: Path, palpate: Command
) -> None:
    shown = palpate("ripeness", *arguments, "--store", made, status=2).err.strip()
    assert message in shown
    assert "\n" not in shown


@pytest.mark.slow
def test_ripeness_example_script_prints_and_plots_its_batch(
    made: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(EXAMPLE), run_name="example")["main"]([str(made), "Monday"])
    output = capsys.readouterr().out
    assert output.startswith("Monday (simulated): 6 fruits")
    assert (folder / "batch.png").stat().st_size > 10_000
