"""Expected error of a force calibration, from cross-validation over loads or placements."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.calibration import ForcePairs
from palpate.errors import CalibrationError
from palpate.force.force_law import ForceLaw
from palpate.force.line_law import LineForceLaw

#: Forces at which the expected error is reported, newtons, and the largest ratio of a load to such
#: a force that counts as near.
_AT_N = (1.0, 5.0, 10.0)
_NEAR = 1.4
#: Keys of these forces.
REPORTED_N = tuple(f"{at_n:g}_n" for at_n in _AT_N)
#: Fewest placements for cross-validation.
FEWEST_PLACEMENTS = 3


def score_placements(
    value_n: FloatArray, *, force_n: FloatArray, run: FloatArray
) -> dict[str, float | None]:
    """Return the median error of predicted forces near 1, 5 and 10 N, percent.

    A grasp is one more placement, so all placements have the same weight. Each contributes its
    readings near the force, or the nearest reading if it did not reach that force. Placements
    differ by a gain that is about the same at every force, and too few of them reach the largest
    forces.

    `value_n`, `force_n`, `run`, shape (n,): prediction, reference and placement.
    """
    least_n = np.maximum(force_n, 1e-3)
    log_force, error = np.log(least_n), np.abs(value_n / least_n - 1)
    found: dict[str, float | None] = {}
    for name, at_n in zip(REPORTED_N, _AT_N, strict=True):
        away = np.abs(log_force - np.log(at_n))
        each = [
            np.median(error[mine & (away <= max(float(away[mine].min()), np.log(_NEAR)))])
            for mine in (run == one for one in np.unique(run))
        ]
        reached = bool((away < np.log(_NEAR)).any())
        found[name] = float(100 * np.median(each)) if reached else None
    return found


def score_loads(value_n: FloatArray, *, force_n: FloatArray) -> dict[str, float | None]:
    """Return the median error of predicted loads near 1, 5 and 10 N, percent.

    `value_n`, `force_n`, shape (n,): NaN where there is no prediction. None if no load is near.
    """
    error = np.abs(value_n / np.maximum(force_n, 1e-3) - 1.0)
    log_force = np.log(np.maximum(force_n, 1e-3))
    found: dict[str, float | None] = {}
    for name, at_n in zip(REPORTED_N, _AT_N, strict=True):
        near = np.isfinite(error) & (np.abs(log_force - np.log(at_n)) < np.log(_NEAR))
        found[name] = float(100 * np.median(error[near])) if near.any() else None
    return found


def score_held_out_loads(excess: ArrayLike, *, force_n: ArrayLike) -> dict[str, float | None]:
    """Return the median error of held-out loads near 1, 5 and 10 N, percent.

    None if no load is near.
    """
    y = np.asarray(force_n, dtype=float)
    return score_loads(predict_held_out_loads(excess, force_n=y), force_n=y)


def predict_held_out_loads(excess: ArrayLike, *, force_n: ArrayLike) -> FloatArray:
    """Predict each load with the law of all other loads; NaN without others.

    All readings of one load are held out together.
    """
    x, y = np.asarray(excess, dtype=float), np.asarray(force_n, dtype=float)
    read_n = np.full(y.shape, np.nan)
    for load in np.unique(y):
        mine = y == load
        if not mine.all():
            law = ForceLaw.fit(x[~mine].tolist(), force_n=y[~mine])
            read_n[mine] = [law.force(one).value for one in x[mine].tolist()]
    return read_n


def score_line_held_out(pairs: ForcePairs, *, horizon_s: float) -> dict[str, float | None]:
    """Return the median error of the paper's line near 1, 5 and 10 N, percent.

    Each placement is held out once; with too few placements, each load.
    """
    settled = np.isclose(pairs.since_move_s, horizon_s)
    percent, force_n = np.array(pairs.relative_percent)[settled], np.array(pairs.force_n)[settled]
    run = np.array(pairs.run)[settled]
    group = run if np.unique(run).size >= FEWEST_PLACEMENTS else force_n
    read_n = np.full(force_n.shape, np.nan)
    for one in np.unique(group):
        mine = group == one
        try:
            law = LineForceLaw.fit(percent[~mine], force_n=force_n[~mine])
        except CalibrationError:
            continue
        read_n[mine] = law.force_n(percent[mine]).value
    return score_loads(read_n, force_n=force_n)
