"""Comments of `Outcome` list all end reasons, with the deciding module."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from palpate import grasp
from palpate.grasp.result import Outcome
from palpate.grasp.safety import Danger

FOLDER = Path(grasp.__file__).parent
LISTED = {
    name: set(re.findall(r"`(\w+)`", comments))
    for comments, name in re.findall(
        r"((?: +#:.*\n)+) +(\w+) = ", (FOLDER / "result.py").read_text().split("class Moment")[0]
    )
}


def deciding() -> list[tuple[str, str]]:
    """Return module and outcome of each place that ends a grasp."""
    dangers = {danger.name: Outcome(danger.outcome).name for danger in Danger}
    found = set()
    for path in FOLDER.glob("*.py"):
        if path.stem in ("result", "verdict", "safety", "state"):
            continue
        text = path.read_text()
        found |= {(path.stem, name) for name in re.findall(r"\bOutcome\.([A-Z_]+)\b(?!:)", text)}
        found |= {(path.stem, dangers[name]) for name in re.findall(r"Danger\.([A-Z_]+)", text)}
    return sorted(found)


def test_outcome_comments_list_a_reason_for_each() -> None:
    assert set(LISTED) == set(Outcome.__members__)


@pytest.mark.parametrize(("module", "outcome"), deciding())
def test_outcome_comments_name_the_deciding_module(module: str, outcome: str) -> None:
    assert module in LISTED[outcome]
