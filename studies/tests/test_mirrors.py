"""The results page lists the relations shared by estimators and twin with valid names."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from palpate.estimate import closing_curve
from palpate.twin.objects import draw_object
from palpate_studies import force_control_world

PAGE = Path(__file__).parents[2] / "docs" / "results.md"


def mirrors() -> list[tuple[str, str]]:
    """Return the first two cells of each row of the table."""
    table = PAGE.read_text().split("| in the estimator | in the twin |")[1].split("\n\n")[0]
    rows = [row.split("|")[1:3] for row in table.splitlines()[2:]]
    return [(one.strip(), other.strip()) for one, other in rows]


def test_mirrors_table_has_rows() -> None:
    assert len(mirrors()) >= 8


@pytest.mark.parametrize("cell", [cell for row in mirrors() for cell in row])
def test_mirrors_table_names_exist_in_code(cell: str) -> None:
    names = re.findall(r"`(palpate[\w.]+)`", cell)
    assert names
    for name in names:
        module, _, attribute = name.rpartition(".")
        assert hasattr(import_module(module), attribute), f"{PAGE.name}: no {name}"


def test_fruit_fraction_is_equal_in_estimator_and_twin() -> None:
    assert closing_curve._FRUIT_FRACTION == force_control_world._FRUIT_FRACTION


def test_twin_exponents_are_among_estimator_shapes() -> None:
    rng = np.random.default_rng(5)
    twins = {draw_object(rng, name).exponent for name in ("strawberry", "ball-44lbs", "ecoflex-10")}
    assert twins <= set(closing_curve._SHAPES)
