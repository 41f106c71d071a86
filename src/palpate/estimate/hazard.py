"""How likely the object ruptures in the next few percent of force, given the curve so far.

A discrete-time survival model: Poisson regression of "ruptures within this step of ln(force)" on
the state of the closing curve, a Weibull law in force whose scale follows the stiffness. Stopping
where this hazard passes a threshold is the firmest grip for a given rate of rupture: every further
step gains the same share of force, so the risk it costs is all that may differ between objects.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.closing import ClosingState

#: Weight of the Gaussian prior on the standardised coefficients, per step seen.
RIDGE = 1e-3
#: Rates are cut off here, far above one rupture per step, so that no exponential overflows.
LARGEST_LOG_RATE = 20.0
#: Newton steps; the likelihood is concave and 12 suffice from any start met so far.
NEWTON_STEPS = 30


@dataclass(frozen=True, slots=True, kw_only=True)
class Hazard:
    """Fitted hazard of rupture per step of ln(force).

    Attributes
    ----------
    kinds : tuple of str
        Kinds of object told apart, each with its own level and its own dependence on force and
        stiffness, drawn towards the common one; empty where none are.
    center, scale : ndarray, shape (4,)
        Of the state vectors that it was fitted on.
    coefficients : ndarray, shape (5 + 3 * n_kinds,)
        Intercept first.
    """

    kinds: tuple[str, ...]
    center: NDArray[np.float64]
    scale: NDArray[np.float64]
    coefficients: NDArray[np.float64]

    def per_step(self, states: Sequence[ClosingState], *, kind: str) -> NDArray[np.float64]:
        """Return the expected ruptures in the step after each state, shape (n_states,)."""
        standardised = (_vectors(states) - self.center) / self.scale
        design = _design(standardised, kinds=[kind] * len(states), known=self.kinds)
        return np.exp(np.minimum(design @ self.coefficients, LARGEST_LOG_RATE))


def fit_hazard(
    paths: Sequence[Sequence[ClosingState]],
    *,
    rupture_force_n: Sequence[float],
    kinds: Sequence[str],
    tell_apart: Sequence[str] = (),
) -> Hazard:
    """Fit the hazard to closings that ended in rupture.

    Parameters
    ----------
    paths : sequence of sequences of ClosingState
        The states of each closing; those past the rupture are passed over.
    rupture_force_n : sequence of float
        Force at which each object ruptured.
    kinds : sequence of str
        Kind of each object.
    tell_apart : sequence of str
        The kinds to tell apart.

    Raises
    ------
    ValueError
        If no closing has a state before its rupture.
    """
    states: list[ClosingState] = []
    ruptured: list[float] = []
    labels: list[str] = []
    for path, limit_n, kind in zip(paths, rupture_force_n, kinds, strict=True):
        before = [state for state in path if state.force_n <= limit_n]
        states += before
        # The level after the last of these was not reached whole.
        ruptured += [0.0] * (len(before) - 1) + [1.0] * bool(before)
        labels += [kind] * len(before)
    if not states:
        raise ValueError("no closing has a state before its rupture: nothing to learn from")
    vectors = _vectors(states)
    center, scale = vectors.mean(axis=0), np.maximum(vectors.std(axis=0), 1e-9)
    design = _design((vectors - center) / scale, kinds=labels, known=tell_apart)
    return Hazard(
        kinds=tuple(tell_apart),
        center=center,
        scale=scale,
        coefficients=_poisson(design, np.array(ruptured)),
    )


def _poisson(design: NDArray[np.float64], events: NDArray[np.float64]) -> NDArray[np.float64]:
    """Newton's method for ridge Poisson regression, the intercept not penalised."""
    penalty = np.full(design.shape[1], RIDGE * len(events))
    penalty[0] = 0.0
    coefficients = np.zeros(design.shape[1])
    coefficients[0] = np.log(max(events.mean(), 1e-6))
    for _ in range(NEWTON_STEPS):
        rate = np.exp(np.minimum(design @ coefficients, LARGEST_LOG_RATE))
        gradient = design.T @ (events - rate) - penalty * coefficients
        curvature = (design * rate[:, None]).T @ design + np.diag(penalty + 1e-9)
        step = np.linalg.solve(curvature, gradient)
        # A long first step can overshoot; bounded, it converges from anywhere.
        coefficients = coefficients + step * min(1.0, 2.0 / max(float(np.abs(step).max()), 1e-12))
    return coefficients


def _vectors(states: Sequence[ClosingState]) -> NDArray[np.float64]:
    vectors = np.array(states, dtype=np.float64).reshape(-1, 4)
    vectors[:, 0] = np.log(vectors[:, 0])
    return vectors


def _design(
    standardised: NDArray[np.float64], *, kinds: Sequence[str], known: Sequence[str]
) -> NDArray[np.float64]:
    columns = [np.ones((len(standardised), 1)), standardised]
    for kind in known:
        member = np.array([label == kind for label in kinds], dtype=np.float64)[:, None]
        columns += [member, member * standardised[:, :2]]
    return np.hstack(columns)
