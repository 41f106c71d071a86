"""The force at which a held object will rupture, predicted from the closing curve so far.

At each force the objects that survived it are a different population, so there is one small
regression of ln(rupture force) on the stiffness for each force level, made of its survivors and of
those at neighbouring levels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.closing import LEVEL_STEP, ClosingState

#: Width of the neighbourhood, in ln(force).
BANDWIDTH = 0.3
#: Ridge, as a share of the neighbourhood's weight.
RIDGE = 1e-3
#: Fewest objects that a level's own regression may rest on; above it the last good one serves.
FEWEST = 6


@dataclass(frozen=True, slots=True, kw_only=True)
class Strength:
    """One regression per force level, from `first_level` up in steps of `LEVEL_STEP`.

    Attributes
    ----------
    first_level : int
        Index of the lowest level: its force is exp(index * LEVEL_STEP).
    lines : ndarray, shape (n_levels, 4)
        Mean ln(stiffness), mean ln(rupture force), slope, residual variance.
    """

    first_level: int
    lines: NDArray[np.float64]

    def predict_n(self, state: ClosingState) -> float:
        """Return the rupture force, N, that minimises the expected relative error.

        For a log-normal belief that point lies one variance below the median: an error of
        prediction counts in share of the true value, so too high costs more than too low.
        """
        level = round(np.log(state.force_n) / LEVEL_STEP) - self.first_level
        center, mean, slope, variance = self.lines[min(max(level, 0), len(self.lines) - 1)]
        log_n = mean + slope * (state.log_stiffness - center) - variance
        # It has survived this force already.
        return max(float(np.exp(log_n)), state.force_n)


def fit_strength(
    paths: Sequence[Sequence[ClosingState]], *, rupture_force_n: Sequence[float]
) -> Strength:
    """Fit the regressions to closings that ended in rupture.

    Parameters
    ----------
    paths : sequence of sequences of ClosingState
        The states of each closing; those past the rupture are passed over.
    rupture_force_n : sequence of float
        Force at which each object ruptured.

    Raises
    ------
    ValueError
        If fewer than `FEWEST` objects have a state before their rupture.
    """
    rows = [
        (item, np.log(state.force_n), state.log_stiffness, np.log(limit_n))
        for item, (path, limit_n) in enumerate(zip(paths, rupture_force_n, strict=True))
        for state in path
        if state.force_n < limit_n
    ]
    items = np.array([row[0] for row in rows])
    if len(np.unique(items)) < FEWEST:
        raise ValueError(f"{len(np.unique(items))} closings to learn from; {FEWEST} are needed")
    log_force, stiffness, target = np.array([row[1:] for row in rows]).T
    first, last = (round(log_force.min() / LEVEL_STEP), round(log_force.max() / LEVEL_STEP))
    lines = []
    for level in range(first, last + 1):
        distance = (log_force - level * LEVEL_STEP) / BANDWIDTH
        if level > first and len(np.unique(items[np.abs(distance) < 1])) < FEWEST:
            break
        lines.append(_line(stiffness, target, weight=np.exp(-0.5 * distance**2)))
    return Strength(first_level=first, lines=np.array(lines))


def _line(
    stiffness: NDArray[np.float64], target: NDArray[np.float64], *, weight: NDArray[np.float64]
) -> tuple[float, float, float, float]:
    center = np.average(stiffness, weights=weight)
    mean = np.average(target, weights=weight)
    x, y = stiffness - center, target - mean
    slope = np.sum(weight * x * y) / (np.sum(weight * x * x) + RIDGE * weight.sum())
    variance = np.average((y - slope * x) ** 2, weights=weight)
    return float(center), float(mean), float(slope), float(variance)
