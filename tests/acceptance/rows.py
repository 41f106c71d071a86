"""What a grasp was like, in one row of numbers; a file of rows."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Sequence
from dataclasses import asdict, astuple, dataclass, fields
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from tests.acceptance.grasps import (
    FAST_TO_FORCE,
    FAULT,
    GRASPS_PER_SHEET,
    TO_FORCE,
    Case,
    Run,
    run_case,
)

from palpate.measurement import Measurement
from palpate_studies.processes import map_batches

BASELINE = Path(__file__).with_name("baseline.csv")
#: A gentle squeeze ends at the first force, with soft fingers at the second; rigid fingers squeeze
#: a stiff object up to the third, or until it deforms by 1 mm.
GENTLE_N, SOFT_GENTLE_N, FIRM_N = 2.0, 1.0, 6.0
#: Largest peak force: this multiple of the target, plus newtons.
_PEAK_RATIO, _PEAK_MORE_N = 1.5, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """One grasp; NaN for what was not measured.

    Attributes
    ----------
    held, damaged : float
        Whether the grasp completed, and whether the object was pressed beyond its yield.
    target_n, peak_n : float
        Target force, or that of a gentle squeeze of this object; largest true force.
    load : float
        Largest true force relative to that at yield.
    touch_s, touch_peak_n, rise_n, answer_s : float
        As in `Run`.
    off_target : float
        ln of the true settled force over the target; only without a damage limit or lift.
    force, force_low, force_high : float
        ln of the reported settled force and its limits over the true one.
    size, size_low, size_high : float
        Reported minus true size, mm.
    stiffness, stiffness_low, stiffness_high : float
        As for the force; of a bound, only the known limit is finite.
    """

    seed: int
    task: str
    kind: str
    level: str
    outcome: str
    damaged: float
    target_n: float
    peak_n: float
    load: float
    touch_s: float
    touch_peak_n: float
    rise_n: float
    answer_s: float
    off_target: float
    force: float
    force_low: float
    force_high: float
    size: float
    size_low: float
    size_high: float
    stiffness: float
    stiffness_low: float
    stiffness_high: float

    @property
    def sheet(self) -> str:
        """Sensor of the grasp: resampled as a whole."""
        return str(self.seed // GRASPS_PER_SHEET)

    @property
    def is_faulty(self) -> bool:
        """Whether something failed during the grasp."""
        return self.task == FAULT

    @property
    def held(self) -> float:
        """Whether the grasp completed."""
        return float(self.outcome == "held")

    @property
    def most_n(self) -> float:
        """Largest allowed force."""
        return _PEAK_RATIO * self.target_n + _PEAK_MORE_N


def describe(run: Run) -> Row:
    """Return the row of a grasp."""
    case, result, truth = run.case, run.result, run.truth
    assert case.obj is not None
    target_n = target_of(case)
    # After a fault, and without a grip at the end, nothing is compared.
    is_gripped = truth.force_n > 0 and case.fault == "none"
    force_n = truth.force_n if is_gripped else np.nan
    size_mm = truth.size_mm if is_gripped and truth.size_mm else np.nan
    has_target = case.task in (TO_FORCE, FAST_TO_FORCE)
    stiffness = truth.stiffness_n_per_mm if is_gripped else None
    return Row(
        seed=case.seed,
        task=case.task,
        kind=case.kind,
        level=case.level,
        outcome=str(result.outcome),
        damaged=float(truth.damaged),
        target_n=target_n,
        peak_n=truth.peak_force_n,
        load=truth.peak_force_n / case.obj.yield_n,
        touch_s=run.touch_s,
        touch_peak_n=run.touch_peak_n,
        rise_n=run.rise_n,
        answer_s=run.answer_s,
        off_target=float(np.log(force_n / target_n)) if has_target else np.nan,
        **_log_errors("force", result.force_n, force_n),
        **_errors("size", result.size_mm, size_mm),
        **_log_errors("stiffness", result.stiffness_n_per_mm, stiffness or np.nan),
    )


def target_of(case: Case) -> float:
    """Return the force that a grasp should end at, N."""
    target_n = case.options.get("target_force_n")
    if target_n is not None:
        return float(target_n)
    if case.kind == "soft":
        return SOFT_GENTLE_N
    assert case.obj is not None
    return float(np.clip(case.obj.force_at_1mm_n, GENTLE_N, FIRM_N))


def _errors(name: str, measured: Measurement | None, truth: float) -> dict[str, float]:
    """Return the errors of a value and of the limits of its interval."""
    value, low, high = None, None, None
    if measured is not None:
        value, (low, high) = measured.value, measured.known_ends
    if (low, high) != (None, None):
        low, high = -np.inf if low is None else low, np.inf if high is None else high
    return {
        name + suffix: np.nan if end is None else float(end - truth)
        for suffix, end in (("", value), ("_low", low), ("_high", high))
    }


def _log_errors(name: str, measured: Measurement | None, truth: float) -> dict[str, float]:
    """Return the errors of the logarithms."""
    with np.errstate(divide="ignore"):
        return {
            key: float(np.log(np.maximum(1.0 + error / truth, 0.0)))
            for key, error in _errors(name, measured, truth).items()
        }


def measure_grasps(cases: Sequence[Case], *, jobs: int) -> list[Row]:
    """Make the grasps, the sensors in `jobs` processes, and return their rows."""
    batches = [list(found) for _, found in groupby(cases, key=lambda case: case.sheet)]
    return map_batches(_measure_batch, batches, jobs=jobs)


def _measure_batch(cases: Sequence[Case]) -> list[Row]:
    return [describe(run_case(case)) for case in cases]


def write_rows(rows: Iterable[Row], file: Path) -> None:
    """Store rows with four digits; what was not measured is empty."""
    with file.open("w", encoding="utf-8", newline="") as lines:
        writer = csv.writer(lines, lineterminator="\n")
        writer.writerow(_NAMES)
        writer.writerows([_text(value) for value in astuple(row)] for row in rows)


def read_rows(file: Path) -> list[Row]:
    """Return the stored rows; a column that is not in the file was not measured."""
    with file.open(encoding="utf-8", newline="") as lines:
        return [_parse({**_EMPTY, **row}) for row in csv.DictReader(lines)]


def round_row(row: Row) -> Row:
    """Return a row with the digits of a stored one."""
    return _parse({name: _text(value) for name, value in asdict(row).items()})


_NAMES = tuple(one.name for one in fields(Row))
_EMPTY = dict.fromkeys(_NAMES, "")
_WORDS = ("task", "kind", "level", "outcome")


def _text(value: str | float) -> str:
    if isinstance(value, float):
        return "" if np.isnan(value) else f"{value:.4g}"
    return str(value)


def _parse(row: dict[str, str]) -> Row:
    values: dict[str, Any] = {
        name: text if name in _WORDS else float(text or "nan") for name, text in row.items()
    }
    return Row(**{**values, "seed": int(row["seed"])})
