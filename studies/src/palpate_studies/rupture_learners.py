"""Learners that see all that a closing curve shows, to test whether it predicts the rupture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import needing
from palpate.estimate.damage_learning import FruitClosing
from palpate_studies.rupture_policies import Scored

#: Learned from are states from this share of the rupture force on: before, all curves are alike.
_FROM_SHARE = 0.2
#: The latest stretch of a curve, mm, and the share of its force over which it is looked at closely.
_LATEST_MM, _LATEST_SHARE = 1.0, 0.7
#: Standing in for a slope or a roughness of nothing.
_LEAST = 1e-3


def features(closing: FruitClosing) -> FloatArray:
    """Return what the curve up to each state shows, shape (n_states, 10).

    ln stiffness over the upper half of the force, and how the stiffness over the last 0.7, over the
    quarter below, and over the last millimetre differ from it; bend and roughness of that
    millimetre; the share of force that was lost again on the way; how finely it was sampled; the
    closure at which it began (the size of the fruit); ln force.
    """
    seen, at = closing.samples, np.searchsorted(_risen(closing), closing.force_n) + 1
    rows = [
        _shown(seen[:count], log_stiffness=state.log_stiffness, force_n=state.force_n)
        for state, count in zip(closing.states, at.tolist(), strict=True)
    ]
    return np.array(rows).reshape(-1, 10)


def _risen(closing: FruitClosing) -> FloatArray:
    """Return the largest force so far at each sample: it rises, however noisy the force is."""
    return np.asarray(np.maximum.accumulate(closing.samples[:, 1]))


def _shown(seen: FloatArray, *, log_stiffness: float, force_n: float) -> list[float]:
    closure_mm, rising_n = seen[:, 0], np.maximum.accumulate(seen[:, 1])

    def secant(low: float, high: float) -> float:
        """Return ln stiffness between two shares of the force, less that of the upper half."""
        forces_n = np.maximum(np.array([low, high]) * force_n, rising_n[0])
        ends_mm = np.interp(forces_n, rising_n, closure_mm)
        if forces_n[1] < 1.03 * forces_n[0]:
            return 0.0
        return float(np.log(np.ptp(forces_n) / max(np.ptp(ends_mm), _LEAST))) - log_stiffness

    latest = seen[closure_mm >= closure_mm[-1] - _LATEST_MM]
    bend, slope, rough = 0.0, np.exp(log_stiffness), _LEAST
    if len(latest) > 5 and np.ptp(latest[:, 0]) > 0.3:
        x = latest[:, 0] - latest[:, 0].mean()
        slope = max(float(np.polyfit(x, latest[:, 1], 1)[0]), _LEAST)
        curve = np.polyfit(x, latest[:, 1], 2)
        bend = float(curve[0]) / slope
        rough = max(float(np.std(latest[:, 1] - np.polyval(curve, x))) / force_n, _LEAST)
    lost_n = -float(np.minimum(np.diff(seen[:, 1]), 0.0).sum())
    return [
        log_stiffness,
        secant(_LATEST_SHARE, 1.0),
        secant(0.25, 0.5),
        float(np.log(slope)) - log_stiffness,
        float(np.clip(bend, -2.0, 2.0)),
        float(np.log(rough)),
        float(np.log1p(lost_n / force_n)),
        float(np.log((np.ptp(closure_mm) + 0.05) / len(seen))),
        float(closure_mm[0]),
        float(np.log(force_n)),
    ]


def learners() -> dict[str, Callable[[], Any]]:
    """Return makers of learners by name.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """
    with needing("rupture-limits", extra="produce"):
        from sklearn.ensemble import ExtraTreesRegressor
        from sklearn.linear_model import RidgeCV
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import StandardScaler
    return {
        "ridge, told everything": lambda: make_pipeline(
            StandardScaler(), RidgeCV(np.geomspace(0.1, 1e3, 9))
        ),
        "extra trees, told everything": lambda: ExtraTreesRegressor(
            120, min_samples_leaf=8, random_state=0
        ),
    }


def learned_scores(
    make: Callable[[], Any],
    *,
    training: Sequence[FruitClosing],
    test: Sequence[FruitClosing],
    shown: dict[str, FloatArray],
) -> list[Scored]:
    """Return force as a share of the rupture force that a learner predicts, for each test closing.

    Parameters
    ----------
    make : callable
        Makes a learner.
    training, test : sequence of FruitClosing
        One learner is trained for each fruit.
    shown : dict of str to ndarray, shape (n_states, n_features)
        What each closing showed, by its `grasp_id`.
    """
    trained = {}
    for fruit in {closing.fruit for closing in test}:
        mine = [c for c in training if c.fruit == fruit and len(c.states)]
        rows = np.concatenate([shown[c.grasp_id] for c in mine])
        share = np.concatenate([_forces_n(c) / c.rupture_force_n for c in mine])
        used = share > _FROM_SHARE
        trained[fruit] = make().fit(rows[used], np.log(share[used]))
    return [
        Scored(c.force_n, np.exp(trained[c.fruit].predict(shown[c.grasp_id])))
        if len(c.states)
        else Scored(c.force_n, np.zeros(0))
        for c in test
    ]


def _forces_n(closing: FruitClosing) -> FloatArray:
    return np.array([state.force_n for state in closing.states])
