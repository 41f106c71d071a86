"""Simple rules for the settled value that learn from other holds: what palpate must not lose to.

All work in ln of positive readings: a hold is what it fell by up to the cut-off, and the truth is
ln(settled / last reading).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold, settled_value
from palpate.settling.baselines import LogLaw

HORIZON_S = 20.0
#: Stretches of log time that the ridge sees of a hold, and its penalties to choose from.
STRETCHES, PENALTIES = 6, np.geomspace(1e-3, 10.0, 9)
_TINY = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """One hold up to a cut-off, in ln: what rules may use, and the truth.

    `profile`, shape (STRETCHES + 1,): the fall in each stretch as a share of the whole, the whole
    and its logarithm. `pace`: the change to come at the pace of the last e-fold; `log_law`: by the
    log law; `change`: that which came.
    """

    profile: FloatArray
    drop: float
    pace: float
    log_law: float
    change: float


def show(hold: Hold, cutoff_s: float) -> Shown:
    """Return what a hold of positive values shows up to a cut-off."""
    seen = hold.time_s <= cutoff_s
    time_s, height = hold.time_s[seen], np.log(hold.values[seen])
    edges = np.geomspace(0.1, cutoff_s + 0.1, STRETCHES + 1) - 0.1
    parts = np.interp((edges[1:] + edges[:-1]) / 2, time_s, height)
    for index, (start_s, end_s) in enumerate(pairwise(edges)):
        inside = (time_s >= start_s) & (time_s <= end_s)
        if inside.any():
            parts[index] = height[inside].mean()
    fall = parts[:-1] - parts[-1]
    drop = float(np.abs(fall).max()) + _TINY
    below = (height - height[-1])[None]
    laws = (LogLaw(wait_s=cutoff_s / np.e), LogLaw(wait_s=0.1, from_s=0.4))
    pace, log_law = (
        float(law.predict(time_s, below, horizon_s=HORIZON_S, level=0.9).hold(0).value)
        for law in laws
    )
    settled = settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S)
    return Shown(
        profile=np.array([*(fall / drop), np.log(drop), drop]),
        drop=drop,
        pace=pace,
        log_law=log_law,
        change=float(np.log(settled) - height[-1]),
    )


Rule = Callable[[Shown], float]


def multiple(others: Mapping[str, Sequence[Shown]]) -> Rule:
    """Return the constant multiple of the last reading: the median of materials alike."""
    change = np.array([one.change for holds in others.values() for one in holds])
    middle = _weighted_median(change, _alike(others))
    return lambda one: middle


def scaled(others: Sequence[Shown], *, by: Callable[[Shown], float]) -> Rule:
    """Return a rule's change times the factor that others ask for (least absolute error)."""
    guess = np.array([by(one) for one in others])
    change = np.array([one.change for one in others])
    known = np.abs(guess) > _TINY
    if not known.any():
        return by
    factor = _weighted_median(change[known] / guess[known], np.abs(guess[known]))
    return lambda one: factor * by(one)


def ridge(others: Mapping[str, Sequence[Shown]]) -> Rule:
    """Return a ridge on every feature, its penalty chosen with one material left out in turn."""
    names = np.repeat(list(others), [len(holds) for holds in others.values()])
    holds = [one for some in others.values() for one in some]
    features = np.array([one.profile for one in holds])
    target = np.array([one.change / one.drop for one in holds])
    weight = _alike(others)

    def miss(penalty: float) -> float:
        return float(
            sum(
                np.median(np.abs(line(features[left]) - target[left]))
                for name in others
                for left in [names == name]
                for line in [_line(features[~left], target[~left], weight[~left], penalty)]
            )
        )

    penalty = min(PENALTIES, key=miss) if len(others) > 1 else 1.0
    line = _line(features, target, weight, float(penalty))
    return lambda one: float(line(one.profile[None])[0]) * one.drop


def _line(
    features: FloatArray, target: FloatArray, weight: FloatArray, penalty: float
) -> Callable[[FloatArray], FloatArray]:
    share = weight / weight.sum()
    middle = share @ features
    spread = np.sqrt(share @ (features - middle) ** 2) + _TINY
    unit = (features - middle) / spread
    level = float(share @ target)
    square = unit.T @ (share[:, None] * unit) + penalty * np.eye(unit.shape[1])
    slope = np.linalg.solve(square, unit.T @ (share * (target - level)))
    return lambda some: np.asarray(level + ((some - middle) / spread) @ slope)


def _alike(others: Mapping[str, Sequence[Shown]]) -> FloatArray:
    return np.concatenate([np.full(len(holds), 1 / len(holds)) for holds in others.values()])


def _weighted_median(values: FloatArray, weights: FloatArray) -> float:
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])
