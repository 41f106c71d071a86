"""`palpate bruise` on the store of `palpate demo packhouse`."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from tests.commands import Command

from palpate.produce.records import About, Source
from palpate.produce.store import Store

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def filled(packhouse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store with an apple that fell between two visits."""
    return Path(shutil.copy(packhouse / "palpate-items.sqlite", tmp_path_factory.mktemp("bruise")))


def test_bruise_dropped_apple_names_the_bruised_pixels(filled: Path, palpate: Command) -> None:
    found = palpate("bruise", "A17", "--json", "--store", filled, status=1).document
    assert found["bruised"]
    assert found["simulated"]
    assert "simulated" in found["learned_on"]
    first, second = found["sides"]
    assert (first["angle_deg"], second["angle_deg"]) == (90.0, 0.0)
    assert first["probability"] > 0.5 > second["probability"]
    assert first["against"] == "history"
    assert first["pixels"]
    assert found["before_percent"] < found["now_percent"] < 0


def test_bruise_sound_apple_exits_with_0_and_stores_the_verdict(
    filled: Path, palpate: Command
) -> None:
    shown = palpate("bruise", "apple-1", "--bruised-share", "0.05", "--store", filled).out
    assert shown.startswith("apple-1: sound (simulated)")
    with Store.open(filled) as store:
        verdicts = store.verdicts_of("apple-1", about=About.BRUISE, source=Source.PALPATE)
    assert [verdict.text for verdict in verdicts] == ["sound"]
