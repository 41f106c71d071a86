"""Damage limit of an object, learned from closings up to rupture.

The *prediction* is the likely rupture force with a lower bound. The *limit* of a grasp
(`DamageModel.bound_n`) is the force below which at most a nominal fraction of objects like those in
the training set ruptures. Both accept forces from any source, and a known or unknown kind of
object.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from palpate.measurement import Measurement
from palpate.object.strength import (
    FEWEST_CLOSINGS,
    ClosingState,
    Strength,
    fit_strength,
)

Path: TypeAlias = Sequence[ClosingState]

#: Default fraction of objects that may be damaged at the limit: a requirement.
NOMINAL_RATE = 0.01
#: Probability that the rupture force is above the lower bound.
LOWER_BOUND_LEVEL = 0.95
FOLDS = 5
#: Search range of the bound, ln N.
_LOG_BOUNDS_N = (-20.0, 20.0)


class RupturePrediction(NamedTuple):
    """Prediction of the rupture force at one moment of a closing, newtons.

    `force_n`: the force level just passed.
    `predicted_n`, `low_n`: likely rupture force, and its lower bound with probability 0.95.
    """

    force_n: float
    predicted_n: float
    low_n: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageScore:
    """Score of a model on closings outside its training set."""

    #: Number of closings with a prediction.
    closings: int
    #: Mean absolute error of the rupture force predicted at half load, percent of the true force.
    error_percent: float
    #: The same for a baseline without stiffness: the median rupture force of the kind.
    median_error_percent: float
    #: Fraction of closings that ruptured above the lower bound; nominally 0.95.
    above_low: float


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageModel:
    """Damage model learned from closings that ended in rupture, by kind of object.

    Attributes
    ----------
    strengths : mapping of str to Strength
        Model of the rupture force, by kind; ``""`` is for kinds without their own model.
    low_fractions : mapping of str to float
        Lower bound as a fraction of the prediction, by kind.
    rate : float
        Fraction of objects that may be damaged at the limit, between 0 and 1.

    Raises
    ------
    ValueError
        If the rate is not between 0 and 1.
    """

    strengths: Mapping[str, Strength]
    low_fractions: Mapping[str, float]
    rate: float = NOMINAL_RATE

    def __post_init__(self) -> None:
        if not 0 < self.rate < 1:
            raise ValueError(f"rate is {self.rate}; it must be between 0 and 1")

    def predict(self, state: ClosingState, *, kind: str = "") -> RupturePrediction:
        """Predict the rupture force from one state of a closing curve (kind ``""``: unknown)."""
        kind = kind if kind in self.strengths else ""
        predicted_n = self.strengths[kind].predict_n(state)
        low_n = max(self.low_fractions[kind] * predicted_n, state.force_n)
        return RupturePrediction(state.force_n, predicted_n, low_n)

    def bound_n(self, stiffness: Measurement, *, kind: str = "") -> float:
        """Return the force below which at most a fraction `rate` of objects are damaged, N.

        A small training set contains no rare objects, so the log-normal law of `Strength`
        extrapolates the bound. The uncertainty of the stiffness is included, because an object that
        may be soft may be weak.

        `stiffness`: stiffness of the gripped object, N/mm.
        `kind`: kind of the object, empty if unknown.
        """

        def excess(log_force: float) -> float:
            return self.damage_rate(float(np.exp(log_force)), stiffness, kind=kind) - self.rate

        return float(np.exp(brentq(excess, *_LOG_BOUNDS_N, xtol=1e-3)))

    def damage_rate(self, force_n: float, stiffness: Measurement, *, kind: str = "") -> float:
        """Return the fraction of objects of this stiffness and kind that a force damages.

        The inverse of `bound_n`.
        """
        strength = self.strengths[kind if kind in self.strengths else ""]
        log_stiffness, weight = strength.stiffness_distribution(stiffness)
        return float(weight @ strength.rupture_probability(force_n, log_stiffness))


def prediction_at_half_load(predictions: Sequence[RupturePrediction]) -> RupturePrediction | None:
    """Return the first prediction at which the force has reached half of the predicted force.

    If the object ruptured earlier, return the last prediction; None without predictions.
    """
    for one in predictions:
        if one.force_n >= one.predicted_n / 2:
            return one
    return predictions[-1] if predictions else None


def fit_damage_model(
    paths: Sequence[Path],
    *,
    rupture_force_n: Sequence[float],
    kinds: Sequence[str],
    by_kind: bool = True,
    rate: float = NOMINAL_RATE,
) -> DamageModel:
    """Fit a damage model to closings that ended in rupture.

    `paths`: states of each closing (`ClosingCurve.push`); states after the rupture are skipped.
    `rupture_force_n`: rupture force of each object, N.
    `kinds`: kind of each object; a kind with fewer than `2 * FEWEST_CLOSINGS` objects has no model
    of its own.
    `by_kind`: whether the kind will be known when the model is used.
    `rate`: fraction of objects that may be damaged at the limit.
    Raises `ValueError` if there are too few closings.
    """
    limits_n = np.asarray(rupture_force_n, dtype=np.float64)
    counts = {kind: list(kinds).count(kind) for kind in sorted(set(kinds))}
    known = [kind for kind, count in counts.items() if by_kind and count >= 2 * FEWEST_CLOSINGS]
    strengths, low_fractions = {}, {}
    for kind in ("", *known):
        chosen = [i for i in range(len(paths)) if kind in ("", kinds[i])]
        strengths[kind] = fit_strength(
            [paths[i] for i in chosen], rupture_force_n=limits_n[chosen].tolist()
        )
        low_fractions[kind] = _lower_bound_fraction([paths[i] for i in chosen], limits_n[chosen])
    return DamageModel(strengths=strengths, low_fractions=low_fractions, rate=rate)


def _lower_bound_fraction(closings: Sequence[Path], limits_n: NDArray[np.float64]) -> float:
    """Return the lower bound as a fraction of the prediction at half load, cross-validated."""
    fractions = []
    for inside, outside in _folds(len(closings)):
        strength = fit_strength(
            [closings[i] for i in inside], rupture_force_n=limits_n[inside].tolist()
        )
        for i in outside:
            for state in closings[i]:
                predicted_n = strength.predict_n(state)
                if state.force_n >= predicted_n / 2:
                    fractions.append(limits_n[i] / predicted_n)
                    break
    rank = int(np.floor((1 - LOWER_BOUND_LEVEL) * (len(fractions) + 1)))
    return float(np.sort(fractions)[rank - 1] if rank else 0.9 * min(fractions))


def _folds(count: int) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Return training and test indices of each fold.

    Closings are assigned to folds in turn by position, so that neighbouring, similar closings are
    in different folds.
    """
    fold = np.arange(count) % FOLDS
    return [(np.flatnonzero(fold != k), np.flatnonzero(fold == k)) for k in range(FOLDS)]
