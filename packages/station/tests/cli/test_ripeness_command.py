"""`palpate ripeness` and `palpate bruise` on the store of `palpate demo packhouse`."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path

import pytest
from tests.commands import Command
from tests.pdf_fonts import check_fonts

from palpate_station.records import About, Source
from palpate_station.store import Store

EXAMPLE = Path(__file__).resolve().parents[4] / "examples" / "batch_ripeness.py"


pytestmark = pytest.mark.usefixtures("folder")


@pytest.fixture(scope="module")
def made(packhouse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(
        shutil.copy(packhouse / "palpate-items.sqlite", tmp_path_factory.mktemp("ripeness"))
    )


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


@pytest.mark.slow
def test_ripeness_example_script_prints_and_plots_its_batch(
    made: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runpy.run_path(str(EXAMPLE), run_name="example")["main"]([str(made), "Monday"])
    output = capsys.readouterr().out
    assert output.startswith("Monday (simulated): 6 fruits")
    assert (folder / "batch.png").stat().st_size > 10_000


@pytest.mark.slow
def test_bruise_dropped_apple_names_the_bruised_pixels(made: Path, palpate: Command) -> None:
    found = palpate("bruise", "A17", "--json", "--store", made, status=1).document
    assert found["bruised"]
    assert found["simulated"]
    assert "simulated" in found["learned_on"]
    first, second = found["sides"]
    assert (first["angle_deg"], second["angle_deg"]) == (90.0, 0.0)
    assert first["probability"] > 0.5 > second["probability"]
    assert first["against"] == "history"
    assert first["pixels"]
    assert max(found["before_percent"], found["now_percent"]) < 0
