"""60 seeded grasps with six sensors: bounds that tuning keeps and an accident exceeds.

`make acceptance` compares 400 with the stored ones, and finds much smaller changes.
"""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
import pytest
from tests.acceptance.grasps import list_cases
from tests.acceptance.rows import BASELINE, Row, measure_grasps, read_rows
from tests.acceptance.table import PARTS, QUANTITIES

#: Rows before and after.
Pairs: TypeAlias = list[tuple[Row, Row]]

pytestmark = pytest.mark.slow
_GRASPS = 60


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    """Make the grasps of the present code; return them with the stored ones."""
    after = measure_grasps(list_cases(_GRASPS), jobs=1)
    return list(zip(read_rows(BASELINE)[:_GRASPS], after, strict=True))


def summarize(name: str, rows: list[Row]) -> float:
    """Return a quantity of the table over the rows in which it is known."""
    quantity = next(one for one in QUANTITIES if one.name == name)
    values = quantity.values(rows)
    return float(quantity.statistic(values[np.isfinite(values)]))


def healthy(pairs: Pairs) -> list[Row]:
    return [after for _, after in pairs if PARTS["all"](after)]


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("held", 0.96, 1.0),
        ("damaged", 0.0, 0.02),
        ("above 1.5 x target + 0.5 N", 0.0, 0.06),
        ("peak / yield, 90 % of grasps", 0.0, 0.40),
        ("off target, ln", 0.0, 0.12),
        ("force: error, ln", 0.0, 0.13),
        ("force: bias, ln", 0.0, 0.10),
        ("force: interval, ln", 0.0, 0.65),
        ("force: covered", 0.8, 1.0),
        ("force: known", 0.95, 1.0),
        ("size: error, mm", 0.0, 0.35),
        ("size: bias, mm", 0.0, 0.25),
        ("size: interval, mm", 0.0, 1.8),
        ("size: covered", 0.85, 1.0),
        ("size: known", 0.6, 1.0),
        ("stiffness: covered", 0.85, 1.0),
    ],
)
def test_quantity_is_within_bounds(pairs: Pairs, name: str, least: float, most: float) -> None:
    assert least <= summarize(name, healthy(pairs)) <= most


@pytest.mark.parametrize(
    ("name", "margin"),
    [
        ("touch, s", 0.3),
        ("answer, s", 0.5),
        ("touch: force, N", 0.15),
        ("largest rise in a step, N", 0.15),
        ("peak / target", 0.08),
    ],
)
def test_quantity_exceeds_the_stored_one_at_most_by(pairs: Pairs, name: str, margin: float) -> None:
    before = [row for row, _ in pairs if PARTS["all"](row)]
    assert summarize(name, healthy(pairs)) <= summarize(name, before) + margin


def test_no_fault_is_missed_or_does_damage(pairs: Pairs) -> None:
    faulty = [after for _, after in pairs if after.is_faulty]
    assert len(faulty) == 6
    assert not any(row.held or row.damaged or row.peak_n > row.most_n for row in faulty)
