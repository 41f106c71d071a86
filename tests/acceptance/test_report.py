"""The acceptance report on stored grasps that were changed by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from tests.acceptance.__main__ import main, report
from tests.acceptance.rows import BASELINE, Row, read_rows, write_rows
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


@pytest.mark.parametrize(("change", "failed"), [(lambda row: row, 0), (drop_some, 3)])
def test_report_counts_what_is_clearly_worse(
    capsys: pytest.CaptureFixture[str], change: Callable[[Row], Row], failed: int
) -> None:
    after = [change(row) for row in STORED]
    assert report(STORED, after) == failed
    changed = sum(old.outcome != new.outcome for old, new in zip(STORED, after, strict=True))
    printed = capsys.readouterr().out
    assert f"{changed} of 120 grasps changed" in printed
    assert ("Clearly worse: held (all)" in printed) == (failed > 0)


def test_baseline_of_other_grasps_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "rows.csv"
    write_rows([replace(STORED[0], target_n=9.0), *STORED[1:]], file)
    with pytest.raises(SystemExit) as left:
        main(["--baseline", str(file), "--grasps", "10"])
    assert left.value.code == 2
    assert f"has no grasp {STORED[0].seed}" in " ".join(capsys.readouterr().err.split())
