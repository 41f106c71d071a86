"""The acceptance report on stored grasps that were changed by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import pytest
from tests.acceptance.rows import BASELINE, Row, read_rows
from tests.acceptance.table import BETTER, SAME, UNDECIDED, WORSE, compare_rows

#: Of twelve sensors, six of them rigid.
STORED = read_rows(BASELINE)[:120]
FAILS = f"{WORSE} (fails)"


def delay_touch(row: Row, by_s: float) -> Row:
    return replace(row, touch_s=row.touch_s + by_s)


def drop_some(row: Row) -> Row:
    return replace(row, outcome="slipped" if row.seed % 3 == 0 else row.outcome)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda row: row, {}),
        (partial(delay_touch, by_s=0.5), {"touch, s": FAILS}),
        (partial(delay_touch, by_s=0.01), {"touch, s": WORSE}),
        (partial(delay_touch, by_s=-0.5), {"touch, s": BETTER}),
        (drop_some, {"held": FAILS}),
    ],
)
def test_only_the_changed_quantity_is_reported(
    change: Callable[[Row], Row], expected: dict[str, str]
) -> None:
    found = compare_rows(STORED, [change(row) for row in STORED])
    for part in ("all", "rigid fingers", "soft fingers"):
        changed = {
            one.quantity.name: one.verdict
            for one in found
            if one.part == part and one.verdict != SAME
        }
        assert changed == expected


def test_few_sensors_decide_nothing() -> None:
    found = compare_rows(STORED[:50], [drop_some(row) for row in STORED[:50]])
    assert {one.verdict for one in found} <= {SAME, UNDECIDED}
