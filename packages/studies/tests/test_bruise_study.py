"""The study of bruised apples at small size."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from palpate_studies import bruise
from palpate_studies.bruise import (
    SAME_WIDTH,
    TOGETHER,
    Examined,
    examine,
    name_method,
)

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def examined() -> list[Examined]:
    """Return a few apples of each purpose.

    A model needs ten bruised and ten sound sides: each apple to learn from is used five times.
    `field` reuses the apples of `lab`.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bruise, "REFERENCE_APPLES", 1)
        made = examine({"learn": 4, "test": 4}, levels=("lab",), seed=900)
    made += [one for one in made if one.purpose == "learn"] * 4
    return made + [replace(one, level="field") for one in made]


def test_report_has_every_method_and_writes_training_sides(
    examined: list[Examined], tmp_path: Path
) -> None:
    found = bruise.judge(examined)
    document = json.loads(json.dumps(found.payload, allow_nan=False))
    for level in ("lab", "field"):
        summary = document["ways"][level]
        ours, trees = name_method("ours", "history"), name_method("boosted trees", "item")
        assert {SAME_WIDTH, TOGETHER, ours, trees} < set(summary)
        assert len(summary) == 8
        assert all(0 <= one["auc"] <= 1 for one in summary.values())
        assert document["apples"][level]["learn"] == 20
        assert sum(row["level"] == level for row in document["compared"]) == 3
    found.write(tmp_path)
    for level in ("lab", "field"):
        written = json.loads((tmp_path / f"bruise-sides-{level}.json").read_text())
        assert level in written["learned_on"]
        assert set(written["sides"]) == {"history", "class", "item"}
