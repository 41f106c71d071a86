"""Errors of a force law on loads that its fit did not see, next to those of a power law."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.force.power_law import PowerForceLaw

#: Probability that the intervals are meant to cover.
LEVEL = 0.9
#: Fewest contacts or loads for held-out errors.
FEWEST_HELD_OUT = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class HeldOut:
    """Errors on contacts, or loads, that the law did not see.

    `what`: what was held out. `groups`, `readings`: their number.
    `median_abs_log_error`, `coverage`: of the law; `power_median_abs_log_error`, `power_coverage`
    of a power law of the same readings, None if it can't be fitted.
    """

    what: str
    groups: int
    readings: int
    median_abs_log_error: float
    coverage: float
    power_median_abs_log_error: float | None
    power_coverage: float | None


def log_error(value_n: float, true_n: float) -> float:
    """Return the absolute error of ln force; a force counts as at least 0.05 N."""
    return abs(float(np.log(max(value_n, 0.05) / true_n)))


def predict_power(
    known: FloatArray, known_n: FloatArray, excess: FloatArray, force_n: FloatArray
) -> tuple[list[float], list[bool]]:
    """Return errors and coverage of a power law; nothing if it can't be fitted."""
    used = known > 0
    try:
        law = PowerForceLaw.fit(known[used], force_n=known_n[used])
    except CalibrationError:
        return [], []
    found = law.force_n(np.maximum(excess, known[used].min() * 1e-3), level=LEVEL)
    errors = [log_error(*pair) for pair in zip(found.value.tolist(), force_n, strict=True)]
    return errors, ((found.low <= force_n) & (force_n <= found.high)).tolist()
