"""A ridge regression that sees all that a closing curve shows: what a learner makes of a fruit."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.damage_learning import FruitClosing
from palpate_studies.baselines.told_everything import scaled_ridge
from palpate_studies.rupture_tradeoff import Scored, Scorer

#: Learned from are states from this fraction of the rupture force on: before, all curves are alike.
_FROM = 0.2
#: The latest stretch of a curve, mm, and the fraction of its force over which it is looked at
#: closely.
_LATEST_MM, _LATEST = 1.0, 0.7
#: In place of a slope or a roughness of nothing.
_LEAST = 1e-3


def learn_ridge(training: Sequence[FruitClosing]) -> Scorer:
    """Learn force as a fraction of the rupture force, one ridge for each fruit.

    Raises
    ------
    MissingExtraError
        If scikit-learn is not installed.
    """
    trained = {}
    for fruit in {closing.fruit for closing in training}:
        mine = [c for c in training if c.fruit == fruit and len(c.states)]
        rows = np.concatenate([features(c) for c in mine])
        load = np.concatenate([c.force_n / c.rupture_force_n for c in mine])
        used = load > _FROM
        trained[fruit] = scaled_ridge().fit(rows[used], np.log(load[used]))

    def score(closing: FruitClosing) -> Scored:
        if not len(closing.states):
            return Scored(closing.force_n, np.zeros(0))
        return Scored(closing.force_n, np.exp(trained[closing.fruit].predict(features(closing))))

    return score


def features(closing: FruitClosing) -> FloatArray:
    """Return what the curve up to each state shows, shape (n_states, 10).

    ln stiffness over the upper half of the force, and how the stiffness over the last 0.7, over the
    quarter below, and over the last millimetre differ from it; bend and roughness of that
    millimetre; the fraction of force that was lost again on the way; how finely it was sampled; the
    closure at which it began (the size of the fruit); ln force.
    """
    return _features_of(_Curve(closing))


class _Curve:
    """A closing known by the numbers of its curve, so that its features are found once."""

    def __init__(self, closing: FruitClosing) -> None:
        self.closing = closing
        self._key = closing.samples.tobytes()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Curve) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)


@lru_cache(maxsize=1024)
def _features_of(curve: _Curve) -> FloatArray:
    closing = curve.closing
    # The force rises, however noisy it is.
    risen = np.maximum.accumulate(closing.samples[:, 1])
    at = np.searchsorted(risen, closing.force_n) + 1
    rows = [
        _shown(closing.samples[:count], log_stiffness=state.log_stiffness, force_n=state.force_n)
        for state, count in zip(closing.states, at.tolist(), strict=True)
    ]
    return np.array(rows).reshape(-1, 10)


def _shown(seen: FloatArray, *, log_stiffness: float, force_n: float) -> list[float]:
    closure_mm, rising_n = seen[:, 0], np.maximum.accumulate(seen[:, 1])

    def secant(low: float, high: float) -> float:
        """Return ln stiffness between two fractions of the force, less that of the upper half."""
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
        secant(_LATEST, 1.0),
        secant(0.25, 0.5),
        float(np.log(slope)) - log_stiffness,
        float(np.clip(bend, -2.0, 2.0)),
        float(np.log(rough)),
        float(np.log1p(lost_n / force_n)),
        float(np.log((np.ptp(closure_mm) + 0.05) / len(seen))),
        float(closure_mm[0]),
        float(np.log(force_n)),
    ]
