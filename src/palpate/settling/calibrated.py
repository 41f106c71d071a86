"""Settled holds calibrate a method: which rule fits them, and how far its errors reach.

Holds of the same sensor (`learn`): the experts are the method as it is, a constant multiple of the
last reading, and lines and multiples of one feature of a hold (the method's forecast, the log law,
the pace of the last e-fold of time). Each is fitted to the past holds and weighed by its errors
where a hold is left out of its own fit. Holds of other specimens set the width alone. The interval
reaches as far as those errors do (Lei et al., "Distribution-Free Predictive Inference for
Regression", JASA 113, 2018), drawn towards the method's own interval while holds are few.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.holds import SETTLED_WINDOW_S, Hold, measure_settled_value
from palpate.settling.baselines import LogLaw
from palpate.settling.percent import without_percent
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate, SettlingMethod, Status

#: From this many calibration holds on, their errors prove an interval.
PROVING_HOLDS = 6
#: The latest own holds are used: a sensor wears, and more sharpen nothing.
MOST_HOLDS = 60
#: The method's own interval counts as this many errors of own holds, and of other specimens'; half
#: of it counts as this many errors of every expert (guesses; study `settled` is flat around them).
_PRIOR_ERRORS, _PRIOR_ERRORS_OF_OTHERS, _PRIOR_ERRORS_OF_EXPERTS = 3.0, 10.0, 2.0
#: Errors are taken at the cut-offs of this ratio: an error changes with the logarithm of time.
_CUTOFF_RATIO = 1.05
_TINY = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """A method with the width, and if `learn` the rule, that settled holds show.

    Attributes
    ----------
    holds : sequence of Hold
        Past holds in the order of recording; those that reach the horizon count. None of them is
        to be predicted.
    method : SettlingMethod
        Predicts without them.
    learn : bool
        Whether the holds are of the sensor itself; if not, they set the width alone.

    Raises
    ------
    CalibrationError
        If there is no hold to learn from.

    Examples
    --------
    Holds that all lose 5 % between 2 s and 20 s:

    >>> time_s = np.arange(1, 301) / 15
    >>> shape = 1 + 0.1 * np.exp(-time_s / 3)
    >>> holds = [Hold(hold_id=str(k), channel=None, time_s=time_s, values=k * shape)
    ...     for k in range(20, 30)]
    >>> method = Calibrated(holds=holds)
    >>> found = method.predict(time_s[:30], 24.5 * shape[None, :30], horizon_s=20.0, level=0.9)
    >>> round(float(found.value[0]), 1), found.status[0].value
    (24.5, 'ok')
    """

    holds: Sequence[Hold]
    method: SettlingMethod = field(default_factory=Relaxation)
    learn: bool = True
    #: By cut-off, horizon, level and whether values are positive: line and sorted errors.
    _known: dict[tuple[float, float, float, bool], tuple[FloatArray, FloatArray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if self.learn and not self.holds:
            raise CalibrationError(
                "no hold to learn from; `palpate calibrate settling` cuts them from recordings"
            )

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return self.method.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`.

        The ends of the interval are NaN where the holds are too few for the level and the method
        has none of its own.
        """
        found = self.method.predict(time_s, values, horizon_s=horizon_s, level=level)
        if time_s[-1] >= horizon_s - SETTLED_WINDOW_S / 2:
            return found
        positive = bool((values > 0).all())
        line, errors = self._calibrate(float(time_s[-1]), horizon_s, level, positive)
        if not (count := errors.size):
            return found
        unit = _unit(values, positive=positive)
        features = self._features(time_s, values, found, horizon_s=horizon_s, unit=unit)
        rank = int(np.ceil((count + 1) * level))
        weight = count / (count + (_PRIOR_ERRORS if self.learn else _PRIOR_ERRORS_OF_OTHERS))
        half = 1.0 if self.learn else _half(found, unit)
        sides = []
        for side in (found.value - found.low, found.high - found.value):
            drawn = weight * half * errors[min(rank, count) - 1] + (1 - weight) * side / unit
            alone = errors[rank - 1] if rank <= count else np.nan
            sides.append(np.where(np.isnan(side), alone, drawn))
        change, last = features @ line, values[:, -1]
        status = np.asarray(found.status).copy()
        if count >= PROVING_HOLDS:
            proven = status != Status.NOT_SETTLING if self.learn else status == Status.UNPROVEN
            status[proven] = Status.OK
        low, value, high = (
            last + unit * end for end in (change - sides[0], change, change + sides[1])
        )
        return replace(found, low=low, value=value, high=high, status=status)

    def _calibrate(
        self, cutoff_s: float, horizon_s: float, level: float, positive: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return the line that predicts changes, and its sorted |errors| on the holds."""
        if cutoff_s > 0:
            cutoff_s = _CUTOFF_RATIO ** round(np.log(cutoff_s) / np.log(_CUTOFF_RATIO))
        key = cutoff_s, horizon_s, level, positive
        if key not in self._known:
            past = [
                one
                for hold in self.holds[-MOST_HOLDS if self.learn else 0 :]
                if (one := self._show_past(without_percent(hold), *key))
            ]
            line, errors = np.array([0.0, 1.0]), np.zeros(0)
            if past:
                features, truth, half = map(np.array, zip(*past, strict=True))
                errors = (truth - features[:, 1]) / np.where(np.isnan(half), 1.0, half)
                if self.learn:
                    line, errors = _learn_line(features, truth, float(half.mean()) / 2)
            self._known[key] = line, np.sort(np.abs(errors))
        return self._known[key]

    def _show_past(
        self, hold: Hold, cutoff_s: float, horizon_s: float, level: float, positive: bool
    ) -> tuple[FloatArray, float, float] | None:
        """Return a past hold's features up to the cut-off, later change and half interval."""
        settled = measure_settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
        time_s = hold.time_s[hold.time_s <= cutoff_s]
        values = hold.values[None, : time_s.size]
        if np.isnan(settled) or not time_s.size or not np.ptp(values):
            return None
        if positive and min(values.min(), settled) <= 0:
            return None
        found = self.method.predict(time_s, values, horizon_s=horizon_s, level=level)
        unit = _unit(values, positive=positive)
        [features] = self._features(time_s, values, found, horizon_s=horizon_s, unit=unit)
        return features, float((settled - values[0, -1]) / unit[0]), float(_half(found, unit)[0])

    def _features(
        self,
        time_s: FloatArray,
        values: FloatArray,
        found: SettledEstimate,
        *,
        horizon_s: float,
        unit: FloatArray,
    ) -> FloatArray:
        """Return one and, if `learn`, each feature: changes since the last sample in its unit."""
        ahead = [np.asarray(found.value)]
        if self.learn:
            fold_s = float(time_s[-1] - time_s[0]) / np.e
            for law in (LogLaw(wait_s=0.1, from_s=0.4), LogLaw(wait_s=fold_s)):
                by_law = law.predict(time_s, values, horizon_s=horizon_s, level=found.level)
                ahead.append(np.asarray(by_law.value))
        changes = [(end - values[:, -1]) / unit for end in ahead]
        return np.column_stack([np.ones(len(values)), *changes])


def _unit(values: FloatArray, *, positive: bool) -> FloatArray:
    """Return what changes are compared with: the last sample, or the change seen."""
    return values[:, -1] if positive else np.maximum(np.ptp(values, axis=1), _TINY)


def _half(found: SettledEstimate, unit: FloatArray) -> FloatArray:
    return np.asarray((found.high - found.low) / 2 / unit)


def _learn_line(
    features: FloatArray, truth: FloatArray, half_interval: float
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted line of the experts, and each hold's error when left out."""
    lines = _fit(features, truth)
    others = [np.arange(truth.size) != k for k in range(truth.size)]
    left_out = np.array([_fit(features[k], truth[k]) for k in others if k.any()] or [lines])
    errors = truth - np.einsum("kef,kf->ek", left_out, features)
    size = (np.abs(errors).sum(axis=1) + _PRIOR_ERRORS_OF_EXPERTS * half_interval) / (
        truth.size + _PRIOR_ERRORS_OF_EXPERTS
    )
    # The likelihood of errors of this mean size (Laplace), each expert at its own best.
    weights = (size.min() / (size + _TINY)) ** truth.size
    weights /= weights.sum()
    return weights @ lines, weights @ errors


def _fit(features: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the experts as lines: method, constant, and a line and multiple per feature.

    The slope of a line counts one hold without any, so it takes several to show one (ridge); the
    multiple is that of the least absolute error.
    """
    features = features[:, 1:]
    n_holds, n_features = features.shape
    lines = np.zeros((2 + 2 * n_features, 1 + n_features))
    lines[0, 1] = 1.0
    by_line, multiples = lines[2 : 2 + n_features], lines[2 + n_features :]
    off, missing = features - features.mean(axis=0), truth - truth.mean()
    slopes = off.T @ missing / (np.square(off).sum(axis=0) * (1 + 1 / n_holds) + _TINY**2)
    by_line[:, 1:] = np.diag(slopes)
    by_line[:, 0] = truth.mean() - slopes * features.mean(axis=0)
    lines[1, 0] = truth.mean()
    size = np.abs(features) + _TINY
    ratio = truth[:, None] * np.sign(features) / size
    order = np.argsort(ratio, axis=0)
    below = np.cumsum(np.take_along_axis(size, order, axis=0), axis=0)
    middle = (below < below[-1] / 2).sum(axis=0)
    columns = np.arange(n_features)
    multiples[:, 1:] = np.diag(ratio[order[middle, columns], columns])
    return lines
