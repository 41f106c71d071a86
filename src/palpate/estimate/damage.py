"""A damage limit learned while closing: where the object will rupture, and where to stop before.

Two answers from one closing curve. The *prediction* is the likely rupture force with a lower bound.
The *limit* of a grasp (`DamageModel.bound_n`) is the force below which at most a nominal share of
objects like those seen ruptures. Both work with a force from any source, with the kind of object
known or not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from palpate.estimate.measurement import Measurement
from palpate.estimate.strength import (
    FEWEST_CLOSINGS,
    ClosingState,
    Strength,
    fit_strength,
)

Path: TypeAlias = Sequence[ClosingState]

#: Default share of objects that the guard may let rupture.
NOMINAL_RATE = 0.01
#: Probability that the rupture force lies above the lower bound.
LOWER_BOUND_LEVEL = 0.95
FOLDS = 5
#: All bounds that are asked for lie between these, ln N.
_LOG_BOUNDS_N = (-20.0, 20.0)
#: Represents the load borne by an object that ruptured before its first force level.
LEAST_LOAD = -6.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageLimit:
    """The damage limit as known at one moment of a closing."""

    #: The force level just passed.
    force_n: float
    #: Likely rupture force, and the force that it exceeds with probability 0.95.
    predicted_n: float
    low_n: float
    #: The load: how far the force has come, in standard deviations of the belief about the rupture
    #: force, which mean the same for every kind of object.
    score: float
    #: Whether closing should stop here.
    stop: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class DamageModel:
    """A model learned from closings that ended in rupture, for one kind of object or for any."""

    #: Shape (n_objects,). The critical loads of all objects, ascending: the largest that each bore,
    #: by models fitted without it.
    critical_scores: NDArray[np.float64]
    #: Prediction of the rupture force, by kind; ``""`` serves the kinds that have none.
    strengths: Mapping[str, Strength]
    #: Lower bound as a share of the prediction, by kind.
    low_shares: Mapping[str, float]

    def stop_score(self, *, nominal_rate: float = NOMINAL_RATE) -> float:
        """Return the score at which to stop so that a new object ruptures at most that often.

        The k-th smallest critical score of n promises a rate of at most k / (n + 1) on objects
        exchangeable with those learned from (conformal prediction). The scores are pooled because
        no kind alone has the hundred objects that a promise of 1 % takes. With too few of them
        even so, the score lies one tail below the smallest.

        Raises `ValueError` if the rate is not between 0 and 1.
        """
        if not 0 < nominal_rate < 1:
            raise ValueError(f"nominal_rate is {nominal_rate}; it must lie between 0 and 1")
        count = len(self.critical_scores)
        rank = int(np.floor(nominal_rate * (count + 1)))
        if rank == 0:
            return float(self.critical_scores[0] - 1)
        return float(self.critical_scores[min(rank, count) - 1])

    def limit(self, state: ClosingState, *, kind: str = "", stop_score: float) -> DamageLimit:
        """Return the limit from one state of a closing curve (kind ``""``: not known)."""
        kind = kind if kind in self.strengths else ""
        strength = self.strengths[kind]
        score, predicted_n = strength.load(state), strength.predict_n(state)
        return DamageLimit(
            force_n=state.force_n,
            predicted_n=predicted_n,
            low_n=max(self.low_shares[kind] * predicted_n, state.force_n),
            score=score,
            stop=score >= stop_score,
        )

    def bound_n(
        self, stiffness: Measurement, *, kind: str = "", rate: float = NOMINAL_RATE
    ) -> float:
        """Return the force below which at most a share `rate` of objects are damaged, N.

        Few closings show no such rare ones: the bound goes on as the log-normal law of `Strength`.
        How stiff the object is is doubted too, and one that may be soft may be weak.

        `stiffness`: of the object between the fingers, N/mm.
        `kind`: kind of the object, empty if not known.
        `rate`: share of objects.
        """

        def excess(log_force: float) -> float:
            return self.rate_below(float(np.exp(log_force)), stiffness, kind=kind) - rate

        return float(np.exp(brentq(excess, *_LOG_BOUNDS_N, xtol=1e-3)))

    def rate_below(self, force_n: float, stiffness: Measurement, *, kind: str = "") -> float:
        """Return the share of such objects that a force damages; the inverse of `bound_n`."""
        strength = self.strengths[kind if kind in self.strengths else ""]
        log_stiffness, weight = strength.likely(stiffness)
        return float(weight @ strength.below(force_n, log_stiffness))


def half_load(limits: Sequence[DamageLimit]) -> DamageLimit | None:
    """Return the limit as it stood when the force first reached half of its own prediction.

    Where the object ruptured before that, the last one known; None where nothing was known.
    """
    for limit in limits:
        if limit.force_n >= limit.predicted_n / 2:
            return limit
    return limits[-1] if limits else None


def fit_damage_model(
    paths: Sequence[Path],
    *,
    rupture_force_n: Sequence[float],
    kinds: Sequence[str],
    by_kind: bool = True,
) -> DamageModel:
    """Learn from closings that ended in rupture.

    `paths`: the states of each closing (`ClosingCurve.push`); those past the rupture are skipped.
    `rupture_force_n`: force at which each object ruptured, N.
    `kinds`: kind of each object; those with fewer than twice `FEWEST` objects count as one.
    `by_kind`: whether the kind will be known when the model is used.
    Raises `ValueError` if there are too few closings to learn from.
    """
    limits_n = np.asarray(rupture_force_n, dtype=np.float64)
    counts = {kind: list(kinds).count(kind) for kind in sorted(set(kinds))}
    known = [kind for kind, count in counts.items() if by_kind and count >= 2 * FEWEST_CLOSINGS]
    strengths, low_shares = {}, {}
    for kind in ("", *known):
        chosen = [i for i in range(len(paths)) if kind in ("", kinds[i])]
        strengths[kind] = fit_strength(
            [paths[i] for i in chosen], rupture_force_n=limits_n[chosen].tolist()
        )
        low_shares[kind] = _low_share([paths[i] for i in chosen], limits_n[chosen])
    critical = _critical_loads(paths, limits_n, kinds=kinds, by_kind=known)
    return DamageModel(
        critical_scores=np.sort(critical), strengths=strengths, low_shares=low_shares
    )


def _critical_loads(
    paths: Sequence[Path],
    limits_n: NDArray[np.float64],
    *,
    kinds: Sequence[str],
    by_kind: Sequence[str],
) -> NDArray[np.float64]:
    """Return the largest load that each object bore on its way to rupture."""
    critical = np.full(len(paths), LEAST_LOAD)
    for kind in ("", *by_kind):
        chosen = np.array([i for i in range(len(paths)) if kind in ("", kinds[i])])
        for inside, outside in _folds(len(chosen)):
            strength = fit_strength(
                [paths[i] for i in chosen[inside]],
                rupture_force_n=limits_n[chosen[inside]].tolist(),
            )
            for i in chosen[outside]:
                loads = [strength.load(s) for s in paths[i] if s.force_n < limits_n[i]]
                critical[i] = max(loads, default=LEAST_LOAD)
    return critical


def _low_share(paths: Sequence[Path], limits_n: NDArray[np.float64]) -> float:
    """Return the share of its prediction at half load that objects exceed with the level."""
    shares = []
    for inside, outside in _folds(len(paths)):
        strength = fit_strength(
            [paths[i] for i in inside], rupture_force_n=limits_n[inside].tolist()
        )
        for i in outside:
            for state in paths[i]:
                predicted_n = strength.predict_n(state)
                if state.force_n >= predicted_n / 2:
                    shares.append(limits_n[i] / predicted_n)
                    break
    rank = int(np.floor((1 - LOWER_BOUND_LEVEL) * (len(shares) + 1)))
    return float(np.sort(shares)[rank - 1] if rank else 0.9 * min(shares))


def _folds(count: int) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Split by position: neighbours in a file are often alike, and land in different folds."""
    fold = np.arange(count) % FOLDS
    return [(np.flatnonzero(fold != k), np.flatnonzero(fold == k)) for k in range(FOLDS)]
