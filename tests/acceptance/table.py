"""The acceptance table: each quantity before and after, and whether it is better or worse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from tests.acceptance.rows import Row

from palpate.arrays import FloatArray
from palpate_studies.protocol.paired import Difference, difference_of_pairs

#: Parts of the table, and their rows.
PARTS: dict[str, Callable[[Row], bool]] = {
    "all": lambda row: not row.is_faulty,
    "rigid fingers": lambda row: not row.is_faulty and row.kind == "rigid",
    "soft fingers": lambda row: not row.is_faulty and row.kind == "soft",
    "with a fault": lambda row: row.is_faulty,
}
BETTER, WORSE, UNDECIDED, SAME = "better", "worse", "undecided", "same"
#: With fewer sensors a bootstrap over them shows nothing.
FEWEST_SHEETS = 6
HEADER = (
    *("quantity", ">grasps", ">before", ">after", ">difference", ">90 % interval"),
    *(">tolerance", "verdict"),
)


def bias(errors: FloatArray) -> np.floating[Any]:
    """Return the absolute mean error."""
    return np.float64(abs(np.mean(errors)))


def median_size(errors: FloatArray) -> np.floating[Any]:
    """Return the median absolute error."""
    return np.float64(np.median(np.abs(errors)))


def highest_tenth(values: FloatArray) -> np.floating[Any]:
    """Return the 90 % quantile."""
    return np.float64(np.quantile(values, 0.9))


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A quantity of many grasps.

    `of`: its value in a grasp, NaN without one. `tolerance`: a change for the worse that is
    accepted; for a certain larger one the report fails.
    """

    name: str
    of: Callable[[Row], float]
    statistic: Callable[[FloatArray], np.floating[Any]]
    tolerance: float
    is_more_better: bool = False
    is_percent: bool = False
    of_faults: bool = False

    def values(self, rows: Sequence[Row]) -> FloatArray:
        """Return the values, shape (grasps,)."""
        return np.array([self.of(row) for row in rows], dtype=float)

    def text(self, value: float, *, sign: str = "") -> str:
        """Return a value as text."""
        return f"{100 * value:{sign}.1f} %" if self.is_percent else f"{value:{sign}.3f}"


def _share(name: str, of: Callable[[Row], float], tolerance: float, **more: bool) -> Quantity:
    return Quantity(
        name=name, of=of, statistic=np.mean, tolerance=tolerance, is_percent=True, **more
    )


def _is_known(name: str, row: Row) -> float:
    return float(np.isfinite(getattr(row, name)))


def _covers(name: str, row: Row) -> float:
    low, high = getattr(row, f"{name}_low"), getattr(row, f"{name}_high")
    return np.nan if np.isnan(low) else float(low <= 0 <= high)


def _width(name: str, row: Row) -> float:
    width = float(getattr(row, f"{name}_high") - getattr(row, f"{name}_low"))
    return width if np.isfinite(width) else np.nan


def _of_measurement(
    name: str, unit: str, *, error: float, width: float, statistic: Any = median_size
) -> list[Quantity]:
    """Return the quantities of a measured one; `error` and `width`: their tolerances."""

    def value(row: Row) -> float:
        return float(getattr(row, name))

    return [
        Quantity(name=f"{name}: error, {unit}", of=value, statistic=statistic, tolerance=error),
        Quantity(name=f"{name}: bias, {unit}", of=value, statistic=bias, tolerance=error),
        _share(f"{name}: covered", partial(_covers, name), 0.03, is_more_better=True),
        Quantity(
            name=f"{name}: interval, {unit}",
            of=partial(_width, name),
            statistic=np.median,
            tolerance=width,
        ),
        _share(f"{name}: known", partial(_is_known, name), 0.03, is_more_better=True),
    ]


QUANTITIES: tuple[Quantity, ...] = (
    _share("held", lambda row: row.held, 0.01, is_more_better=True),
    _share("damaged", lambda row: row.damaged, 0.01, of_faults=True),
    _share("above 1.5 x target + 0.5 N", lambda row: row.peak_n > row.most_n, 0.01, of_faults=True),
    Quantity(
        name="peak / target",
        of=lambda row: row.peak_n / row.target_n,
        statistic=np.mean,
        tolerance=0.03,
        of_faults=True,
    ),
    Quantity(
        name="peak / yield, 90 % of grasps",
        of=lambda row: row.load,
        statistic=highest_tenth,
        tolerance=0.03,
    ),
    Quantity(
        name="touch: force, N", of=lambda row: row.touch_peak_n, statistic=np.mean, tolerance=0.05
    ),
    Quantity(
        name="largest rise in a step, N",
        of=lambda row: row.rise_n,
        statistic=np.mean,
        tolerance=0.05,
    ),
    Quantity(name="touch, s", of=lambda row: row.touch_s, statistic=np.mean, tolerance=0.1),
    Quantity(name="answer, s", of=lambda row: row.answer_s, statistic=np.mean, tolerance=0.2),
    Quantity(
        name="answer, 90 % of grasps, s",
        of=lambda row: row.answer_s,
        statistic=highest_tenth,
        tolerance=0.5,
    ),
    Quantity(
        name="off target, ln", of=lambda row: row.off_target, statistic=median_size, tolerance=0.02
    ),
    Quantity(
        name="off target: bias, ln", of=lambda row: row.off_target, statistic=bias, tolerance=0.02
    ),
    *_of_measurement("force", "ln", error=0.02, width=0.05),
    *_of_measurement("size", "mm", error=0.05, width=0.1),
    *_of_measurement("stiffness", "ln", error=0.03, width=0.05),
    _share("fault not noticed", lambda row: row.held, 0.05, of_faults=True),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """A quantity of the same grasps before and after."""

    part: str
    quantity: Quantity
    before: float
    after: float
    difference: Difference

    @property
    def is_clearly_worse(self) -> bool:
        """Whether it is certainly worse by more than the tolerance."""
        return self._is_decidable and self._least_worsening > self.quantity.tolerance

    @property
    def verdict(self) -> str:
        """Return whether it is better or worse, as far as is certain."""
        found = self.difference
        if found.low == found.high == found.value == 0:
            return SAME
        if not self._is_decidable:
            return UNDECIDED
        if self._least_worsening > 0:
            return WORSE + " (fails)" * self.is_clearly_worse
        is_better = found.low > 0 if self.quantity.is_more_better else found.high < 0
        return BETTER if is_better else UNDECIDED

    @property
    def _is_decidable(self) -> bool:
        return self.difference.specimens >= FEWEST_SHEETS

    @property
    def _least_worsening(self) -> float:
        found = self.difference
        return -found.high if self.quantity.is_more_better else found.low

    def cells(self) -> tuple[str, ...]:
        """Return the row of the table."""
        found, text = self.difference, self.quantity.text
        return (
            self.quantity.name,
            str(found.cases),
            text(self.before),
            text(self.after),
            text(found.value, sign="+"),
            f"{text(found.low, sign='+')} to {text(found.high, sign='+')}",
            text(self.quantity.tolerance),
            self.verdict,
        )


def compare_rows(before: Sequence[Row], after: Sequence[Row]) -> list[Comparison]:
    """Compare the same grasps before and after, in each part.

    Sensors are resampled as a whole. Grasps in which a quantity is unknown before or after are left
    out of its comparison; how many are known is a quantity of its own.
    """
    found = []
    for part, is_in in PARTS.items():
        pairs = [pair for pair in zip(before, after, strict=True) if is_in(pair[0])]
        for quantity in QUANTITIES:
            is_fault_part = part == "with a fault"
            if quantity.of_faults if is_fault_part else quantity.name != "fault not noticed":
                found += _compare(part, quantity, pairs)
    return found


def _compare(part: str, quantity: Quantity, pairs: Sequence[tuple[Row, Row]]) -> list[Comparison]:
    """Return the comparison; none if the part has no such quantity."""
    old = quantity.values([before for before, _ in pairs])
    new = quantity.values([after for _, after in pairs])
    both = np.isfinite(old) & np.isfinite(new)
    if not both.any():
        return []
    old, new = old[both], new[both]
    sheets = [before.sheet for (before, _), is_known in zip(pairs, both, strict=True) if is_known]
    if np.array_equal(old, new):
        difference = Difference(
            value=0.0, low=0.0, high=0.0, cases=len(old), specimens=len(set(sheets))
        )
    else:
        difference = difference_of_pairs(new, old, sheets, statistic=quantity.statistic)
    return [
        Comparison(
            part=part,
            quantity=quantity,
            before=float(quantity.statistic(old)),
            after=float(quantity.statistic(new)),
            difference=difference,
        )
    ]
