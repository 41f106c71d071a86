"""Force from a reading and its history: a ridge on smooth bumps, learned in closed form.

The model is linear in the inputs (`force_states`) plus bumps around landmarks, inputs drawn from
the training samples. A ridge keeps the bumps small where samples do not ask for them, so between
samples the model is smooth and far from them it is a plane: the power law with linear memory. It
predicts any target (ln force, the change of ln force since a measured one, newtons).

Interval widths are not assumed. They are a second, coarser ridge on the errors made on groups left
out, scaled so that the interval covers those errors at its level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError

#: Candidates of bump width (in standard deviations of an input, times the root of their number)
#: and of the ridge, from stiff to loose. The stiffest is taken whose error on groups left out is
#: within this factor of the best: few groups show no finer difference.
SETTINGS = ((2.0, 1e-3), (1.0, 1e-3), (1.0, 1e-4), (0.5, 1e-4), (0.3, 1e-4))
_AS_GOOD = 1.05
#: Most landmarks: more cost time and gain nothing on strokes.
_LANDMARKS = 120
_LINEAR_RIDGE = 1e-2
#: Errors of the target below this are as good as none, and larger ones count in proportion rather
#: than squared: a share of each recording is a slip or a bounce.
_GOOD_ENOUGH, _POWER, _ROUNDS = 0.05, 0.7, 4
#: Left-out parts from which settings and interval widths are learned.
_FOLDS = 5
#: Samples from which settings and interval widths are learned, about.
_ENOUGH = 6000
_FEWEST = 5
#: Level at which the tail of the errors is measured.
_LEVEL = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Bumps:
    """From inputs to what the ridge weighs: one, the standardised inputs, the bumps."""

    centre: FloatArray
    scale: FloatArray
    landmarks: FloatArray
    length: float

    def __call__(self, inputs: FloatArray) -> FloatArray:
        z = (inputs - self.centre) / self.scale
        square = (z**2).sum(axis=1)[:, None] + (self.landmarks**2).sum(axis=1)
        away = np.maximum(square - 2 * z @ self.landmarks.T, 0.0)
        bumps = np.exp(-away / (2 * self.length**2))
        return np.concatenate([np.ones((len(z), 1)), z, bumps], axis=1)

    def penalty(self, constant: float, slope: float, bump: float) -> FloatArray:
        """Return the matrix of a ridge; bumps are weighed as a Gaussian process weighs them."""
        inputs, count = self.landmarks.shape[1], len(self.landmarks)
        away = ((self.landmarks[:, None] - self.landmarks) ** 2).sum(axis=-1)
        matrix = np.zeros((1 + inputs + count,) * 2)
        matrix[0, 0] = constant
        matrix[1 : 1 + inputs, 1 : 1 + inputs] = slope * np.eye(inputs)
        smooth = np.exp(-away / (2 * self.length**2))
        matrix[1 + inputs :, 1 + inputs :] = bump * (smooth + 1e-5 * np.eye(count))
        return matrix


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForceModel:
    """A learned law from inputs to a target, with an interval.

    Attributes
    ----------
    centre, scale : ndarray, shape (n_inputs,)
        Mean and standard deviation of the inputs in training.
    landmarks : ndarray, shape (n_landmarks, n_inputs)
        Centres of the bumps, standardised.
    length : float
        Width of the bumps.
    ridge : float
        Of the bumps.
    weights, spread : ndarray, shape (1 + n_inputs + n_landmarks,)
        Of the target, and of ln |error|.
    tail : float
        Half width of the 90 % interval, in typical errors.
    """

    centre: FloatArray
    scale: FloatArray
    landmarks: FloatArray
    length: float
    ridge: float
    weights: FloatArray
    spread: FloatArray
    tail: float

    @classmethod
    def fit(
        cls,
        inputs: ArrayLike,
        *,
        target: ArrayLike,
        group: Sequence[object],
        weight: ArrayLike | None = None,
        robust: bool = True,
    ) -> ForceModel:
        """Learn from samples with a reference force.

        Parameters
        ----------
        inputs : array_like, shape (n, n_inputs)
            See `force_states.states_of`; whatever else is known may stand next to them.
        target : array_like, shape (n,)
            Usually ln force.
        group : sequence, length n
            Samples of one group (a sensor, a press) are left out together where settings and
            interval widths are learned.
        weight : array_like, shape (n,), optional
            How much each sample counts.
        robust : bool
            Whether large errors count less than squared.

        Raises
        ------
        CalibrationError
            If there are fewer than 5 samples, or a value is not finite.

        Examples
        --------
        >>> x = np.linspace(0.0, 4.0, 80)[:, None]
        >>> model = ForceModel.fit(x, target=0.5 * x[:, 0], group=[0, 1] * 40)
        >>> value, half = model.predict([[2.0]])
        >>> abs(value.item() - 1.0) < 0.01, half.item() < 0.05
        (True, True)
        """
        x, y = np.asarray(inputs, dtype=float), np.asarray(target, dtype=float)
        w = np.ones(len(y)) if weight is None else np.asarray(weight, dtype=float)
        if len(y) < _FEWEST:
            raise CalibrationError(
                f"{len(y)} samples with a reference force, at least {_FEWEST} are needed"
            )
        if not (np.isfinite(x).all() and np.isfinite(y).all()):
            raise CalibrationError("a reading or reference force is not a finite number")
        # Neighbouring samples repeat each other: every n-th shows the errors as well.
        few = slice(None, None, max(len(y) // _ENOUGH, 1))
        seen = x[few], y[few], w[few], _folds(list(group)[few])
        tried = [_left_out(cls, *seen, length=a, ridge=b, robust=robust) for a, b in SETTINGS]
        cost = np.array([w[few] @ (np.abs(left) if robust else left**2) for left in tried])
        best = int(np.flatnonzero(cost <= _AS_GOOD * cost.min())[0])
        length, ridge = SETTINGS[best]
        model = cls._weighed(x, y, w, length=length, ridge=ridge, robust=robust)
        return model.with_errors(x[few], errors=tried[best], weight=w[few])

    @classmethod
    def _weighed(
        cls,
        x: FloatArray,
        y: FloatArray,
        w: FloatArray,
        *,
        length: float,
        ridge: float,
        robust: bool,
    ) -> ForceModel:
        centre = np.average(x, axis=0, weights=w)
        scale = np.sqrt(np.average((x - centre) ** 2, axis=0, weights=w))
        scale[scale < 1e-9] = 1.0
        # A draw with a fixed seed: the same recordings give the same model.
        rng = np.random.default_rng(0)
        drawn = rng.choice(len(x), size=min(_LANDMARKS, len(x)), replace=False, p=w / w.sum())
        bumps = _Bumps(
            centre=centre,
            scale=scale,
            landmarks=(x[drawn] - centre) / scale,
            length=length * float(np.sqrt(x.shape[1])),
        )
        weights = _solved(bumps(x), y, w / w.sum(), bumps.penalty(0, _LINEAR_RIDGE, ridge), robust)
        return cls(
            centre=centre,
            scale=scale,
            landmarks=bumps.landmarks,
            length=bumps.length,
            ridge=ridge,
            weights=weights,
            spread=np.zeros_like(weights),
            tail=1.0,
        )

    @property
    def _bumps(self) -> _Bumps:
        return _Bumps(
            centre=self.centre, scale=self.scale, landmarks=self.landmarks, length=self.length
        )

    def predict(self, inputs: ArrayLike, *, level: float = 0.9) -> tuple[FloatArray, FloatArray]:
        """Return the target of each row and the half width of its interval, shape (n,) each."""
        basis = self._bumps(np.asarray(inputs, dtype=float))
        typical = np.exp(np.clip(basis @ self.spread, -6.0, 3.0))
        reach = float(ndtri(0.5 + level / 2) / ndtri(0.5 + _LEVEL / 2))
        return basis @ self.weights, reach * self.tail * typical

    def with_errors(
        self, inputs: ArrayLike, *, errors: ArrayLike, weight: ArrayLike | None = None
    ) -> ForceModel:
        """Return the model with interval widths learned from errors that it made.

        Parameters
        ----------
        inputs : array_like, shape (n, n_inputs)
            Where they were made.
        errors : array_like, shape (n,)
            On samples that the weights had not seen.
        weight : array_like, shape (n,), optional
            How much each sample counts.
        """
        left = np.abs(np.asarray(errors, dtype=float))
        bumps = self._bumps
        basis = bumps(np.asarray(inputs, dtype=float))
        least = max(0.1 * float(np.median(left)), 1e-6)
        share = np.ones(len(left)) if weight is None else np.asarray(weight, dtype=float)
        share = share / share.sum()
        # Coarse: bumps a hundred times stiffer than the law's, because a single error shows little
        # of how wide errors are.
        spread = _solved(basis, np.log(left + least), share, bumps.penalty(0, 0.01, 0.1), False)
        ratio = left / np.exp(np.clip(basis @ spread, -6.0, 3.0))
        order = np.argsort(ratio)
        beyond = int(np.searchsorted(np.cumsum(share[order]), _LEVEL))
        tail = float(ratio[order[min(beyond, len(order) - 1)]])
        return replace(self, spread=spread, tail=max(tail, 1e-6))


def _folds(group: Sequence[object]) -> list[NDArray[np.bool_]]:
    """Return which samples are left out together, at most five parts."""
    names = list(dict.fromkeys(group))
    part = {name: place % _FOLDS for place, name in enumerate(names)}
    number = np.array([part[name] for name in group])
    return [number == k for k in range(min(_FOLDS, len(names)))]


def _left_out(
    cls: type[ForceModel],
    x: FloatArray,
    y: FloatArray,
    w: FloatArray,
    folds: Sequence[NDArray[np.bool_]],
    **settings: Any,
) -> FloatArray:
    """Return the error of each sample by a model learned without its group."""
    left = np.empty_like(y)
    for fold in folds:
        inside = ~fold if not fold.all() else fold
        model = cls._weighed(x[inside], y[inside], w[inside], **settings)
        left[fold] = model.predict(x[fold])[0] - y[fold]
    return left


def _solved(
    basis: FloatArray, y: FloatArray, w: FloatArray, penalty: FloatArray, robust: bool
) -> FloatArray:
    """Return ridge weights; robust ones by a few rounds of reweighting."""
    share: FloatArray = w
    found: FloatArray = np.zeros(basis.shape[1])
    for _ in range(_ROUNDS if robust else 1):
        weighed = basis * share[:, None]
        normal = weighed.T @ basis + penalty
        normal[np.diag_indices_from(normal)] += 1e-9
        found = np.asarray(np.linalg.solve(normal, weighed.T @ y), dtype=float)
        left = np.maximum(np.abs(y - basis @ found), _GOOD_ENOUGH)
        share = w * (float(np.average(left, weights=w)) / left) ** _POWER
    return found
