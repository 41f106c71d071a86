"""`palpate bruise`, as a user runs it on the store of `palpate demo packhouse`."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from palpate.cli import build_app, run
from palpate.produce.records import About, Item, Source
from palpate.produce.store import Store

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def filled(packhouse: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a store with an apple that fell between two visits."""
    return Path(shutil.copy(packhouse / "palpate-items.sqlite", tmp_path_factory.mktemp("bruise")))


def ask(path: Path, *arguments: str) -> int:
    return run(build_app(), ["bruise", *arguments, "--store", str(path)], name="palpate")


def test_the_dropped_apple_is_bruised_where_it_is(
    filled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ask(filled, "A17", "--json") == 1
    found = json.loads(capsys.readouterr().out)
    assert found["bruised"]
    assert found["simulated"]
    assert "simulated" in found["learned_on"]
    first, second = found["sides"]
    assert (first["angle_deg"], second["angle_deg"]) == (90.0, 0.0)
    assert first["probability"] > 0.5 > second["probability"]
    assert first["against"] == "history"
    assert first["pixels"]
    assert found["before_percent"] < found["now_percent"] < 0


def test_a_sound_apple_is_sound_and_the_card_says_that_it_is_simulated(
    filled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ask(filled, "apple-1", "--bruised-share", "0.05") == 0
    said = capsys.readouterr().out
    assert said.startswith("apple-1: sound (simulated)")
    assert "history" in said or "class" in said or "item" in said


def test_each_answer_is_kept_with_the_item(filled: Path) -> None:
    def kept() -> list[str]:
        with Store.open(filled) as store:
            said = store.verdicts_of("apple-1", about=About.BRUISE, source=Source.PALPATE)
        return [verdict.text for verdict in said]

    before = kept()
    assert ask(filled, "apple-1", "--bruised-share", "0.05") == 0
    assert kept() == [*before, "sound"]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("nobody",), "no item 'nobody'"),
        (("A17", "--learn"), "learning takes 10 of each"),
        (("A17", "--bruised-share", "1.5"), "--bruised-share"),
    ],
)
def test_mistakes_are_told_in_one_line(
    filled: Path, arguments: tuple[str, ...], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert ask(filled, *arguments) == 2
    error = capsys.readouterr().err
    assert says in error
    assert len(error.strip().splitlines()) == 1


def test_an_item_without_a_kind_can_not_be_learned_about(
    filled: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Store.open(filled) as store:
        store.add_item(Item(item_id="thing"))
    assert ask(filled, "thing", "--learn") == 2
    assert "has no kind" in capsys.readouterr().err
