"""Ways to decide when to stop closing on a fruit, and where each would have stopped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.damage import DamageModel
from palpate.estimate.damage_learning import FruitClosing
from palpate.estimate.measurement import Measurement
from palpate.estimate.strength import ClosingState

#: Half of the interval of a stiffness by load cell and encoder, as a share of it.
_EXACT = 0.01
#: Fruit -> mm by which the stiffness is multiplied, N that are added, and N that are given while
#: there are too few samples: the parameters of its authors' evaluation (github.com/SheepLiu712/
#: FruitRuptureEstimate).
PUBLISHED: dict[str, tuple[float, float, float]] = {
    "banana": (3.33, 0.254, 7.008),
    "kiwi": (2.78, 0.345, 3.652),
    "mango": (2.408, 1.666, 11.033),
}
#: Samples in the window that the stiffness is read from, by least squares: fewest and most.
_FEWEST, _MOST = 10, 60


class Scored(NamedTuple):
    """How near the limit a policy thinks to be, with the force at which it came to think so."""

    force_n: NDArray[np.float64]
    score: NDArray[np.float64]


def shipped_scores(closing: FruitClosing, *, model: DamageModel, kind_known: bool) -> Scored:
    """Return the share of such fruit that each force would damage, as a grasp's limit has it.

    A grasp stops below `DamageModel.bound_n`; the share reaches the nominal rate at that force.
    """
    kind = closing.fruit if kind_known else ""
    shares = [
        model.rate_below(state.force_n, _measured(state), kind=kind) for state in closing.states
    ]
    return Scored(closing.force_n, np.array(shares))


def _measured(state: ClosingState) -> Measurement:
    """Return the stiffness of a curve as a measurement: the load cell shows it well."""
    value = float(np.exp(state.log_stiffness))
    low, high = value / (1 + _EXACT), value * (1 + _EXACT)
    return Measurement(value=value, low=low, high=high, unit="n_per_mm")


def cap_scores(closing: FruitClosing, *, median_n: float) -> Scored:
    """Score of the cap per fruit: force as a share of the fruit's median rupture force."""
    return Scored(closing.force_n, np.array([s.force_n for s in closing.states]) / median_n)


def rule_scores(closing: FruitClosing, *, line: tuple[float, float]) -> Scored:
    """Score of the linear stiffness rule: force as a share of what the rule predicts."""
    intercept_n, slope_mm = line
    stiffness = np.exp([state.log_stiffness for state in closing.states])
    predicted_n = np.maximum(intercept_n + slope_mm * stiffness, 0.1)
    force_n = np.array([state.force_n for state in closing.states])
    return Scored(closing.force_n, force_n / predicted_n)


def published_scores(closing: FruitClosing) -> Scored:
    """Return force as a share of what the published rule predicts, sample by sample.

    Raises
    ------
    KeyError
        For a fruit that it has no constants for.
    """
    slope_mm, offset_n, first_n = PUBLISHED[closing.fruit]
    closure_mm, force_n = closing.samples.T
    predicted_n = np.full(len(force_n), first_n)
    for count in range(_FEWEST, len(force_n) + 1):
        window = slice(max(0, count - _MOST), count)
        x = closure_mm[window] - closure_mm[window].mean()
        if power := float(x @ x):
            predicted_n[count - 1] = slope_mm * float(x @ force_n[window]) / power + offset_n
    return Scored(force_n, force_n / np.maximum(predicted_n, 0.1))


def fit_rule(closings: Sequence[FruitClosing]) -> tuple[float, float]:
    """Fit rupture force = intercept + slope x stiffness, the stiffness as it is at half load."""
    stiffness, limits_n = [], []
    for closing in closings:
        reached = [s for s in closing.states if s.force_n >= closing.rupture_force_n / 2]
        if reached:
            stiffness.append(np.exp(reached[0].log_stiffness))
            limits_n.append(closing.rupture_force_n)
    slope, intercept = np.polyfit(stiffness, limits_n, 1)
    return float(intercept), float(slope)


def stop_forces(
    scored: Sequence[Scored],
    *,
    rupture_force_n: Sequence[float],
    at: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return where each closing stops when its score first reaches each setting.

    Parameters
    ----------
    scored : sequence of Scored, length n
        One per closing.
    rupture_force_n : sequence of float, length n
        What the fruit stood.
    at : ndarray, shape (n_settings,)
        Scores at which to stop.

    Returns
    -------
    ndarray, shape (n, n_settings)
        Force, N; the rupture force where it didn't stop in time.
    """
    stops = np.empty((len(scored), len(at)))
    for row, (one, limit_n) in enumerate(zip(scored, rupture_force_n, strict=True)):
        highest = np.maximum.accumulate(one.score)
        first = np.searchsorted(highest, at) if len(highest) else np.zeros(len(at), dtype=int)
        stops[row] = np.append(one.force_n, limit_n)[first]
    return stops
