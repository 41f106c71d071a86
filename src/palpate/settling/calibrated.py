"""Calibration of a predictor with settled holds: a correction rule, and the interval width.

With holds of the same sensor (`learn`), the correction is a weighted mean of experts. The experts
are the method itself, and lines and multiples of one feature of a hold (the method's forecast, the
log law, the rate in the last e-fold of time). Each
expert is fitted to the past holds and weighted by its leave-one-out errors. Holds of other
specimens set only the interval width. The half-width is a quantile of these errors (Lei et al.,
"Distribution-Free Predictive Inference for Regression", JASA 113, 2018), shrunk towards the
method's own interval if there are few holds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.holds import SETTLED_WINDOW_S, Hold, measure_settled_value
from palpate.measurement import Status
from palpate.settling.baselines import LogLaw
from palpate.settling.percent import without_percent
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate, SettlingMethod

#: Minimum number of calibration holds that raise a status to `ok`. Fewer of the same sensor prove
#: nothing: with three, intervals of a Velostat sensor covered .6 to .9.
MIN_PROOF_HOLDS = 6
#: Number of the sensor's latest holds to use: a sensor wears, and more holds give no better result.
_MAX_HOLDS = 60
#: Weight of the method's own interval, as a number of errors: for holds of the same sensor, and of
#: other specimens. Half of the half-width has the third weight in the mean error of each expert
#: (guesses; the result of study `settled` depends little on them).
_PRIOR_ERRORS, _PRIOR_ERRORS_OF_OTHERS, _PRIOR_ERRORS_OF_EXPERTS = 3.0, 10.0, 2.0
#: Cut-offs are rounded to powers of this ratio, because errors change with the logarithm of time.
_CUTOFF_RATIO = 1.05
_TINY = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibrated:
    """A predictor whose interval width, and with `learn` its value, is calibrated with holds.

    Attributes
    ----------
    holds : sequence of Hold
        Past holds in the order of recording. Only holds that reach the horizon are used. They must
        not include the hold to predict.
    method : SettlingMethod
        The method to calibrate.
    learn : bool
        Whether the holds are of the same sensor. Otherwise they set only the interval width.

    Raises
    ------
    CalibrationError
        If there are no holds to learn from.

    Examples
    --------
    Holds that all fall by 5 % between 2 s and 20 s:

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
    #: Line and sorted errors by cut-off, horizon, level and sign of the values.
    _cache: dict[tuple[float, float, float, bool], tuple[FloatArray, FloatArray]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if self.learn and not self.holds:
            raise CalibrationError(
                "no holds to learn from; `palpate calibrate settling` extracts them from recordings"
            )

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return self.method.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`.

        The limits of the interval are NaN if there are too few holds for the level and the method
        has no interval of its own.
        """
        found = self.method.predict(time_s, values, horizon_s=horizon_s, level=level)
        if time_s[-1] >= horizon_s - SETTLED_WINDOW_S / 2:
            return found
        positive = bool((values > 0).all())
        line, errors = self._calibrate(float(time_s[-1]), horizon_s, level, positive)
        if not (count := errors.size):
            return found
        unit = _unit(values, positive=positive)
        features = self._features(time_s, values, found, unit)
        rank = int(np.ceil((count + 1) * level))
        weight = count / (count + (_PRIOR_ERRORS if self.learn else _PRIOR_ERRORS_OF_OTHERS))
        half_width = 1.0 if self.learn else _half_width(found, unit)
        error = half_width * errors[min(rank, count) - 1]
        sides = np.stack((found.value - found.low, found.high - found.value)) / unit
        unshrunk = errors[rank - 1] if rank <= count else np.nan
        sides = np.where(np.isnan(sides), unshrunk, weight * error + (1 - weight) * sides)
        change, last = features @ line, values[:, -1]
        status = np.asarray(found.status).copy()
        if count >= MIN_PROOF_HOLDS:
            is_proven = status != Status.NOT_SETTLING if self.learn else status == Status.UNPROVEN
            status[is_proven] = Status.OK
        elif self.learn:
            status[status == Status.OK] = Status.UNPROVEN
        low, value, high = (
            last + unit * end for end in (change - sides[0], change, change + sides[1])
        )
        return replace(found, low=low, value=value, high=high, status=status)

    def _calibrate(
        self, cutoff_s: float, horizon_s: float, level: float, positive: bool
    ) -> tuple[FloatArray, FloatArray]:
        """Return the line that predicts changes, and its sorted absolute errors on the holds."""
        if cutoff_s > 0:
            cutoff_s = _CUTOFF_RATIO ** round(np.log(cutoff_s) / np.log(_CUTOFF_RATIO))
        key = cutoff_s, horizon_s, level, positive
        if key not in self._cache:
            examples = [
                example
                for hold in self.holds[-_MAX_HOLDS if self.learn else 0 :]
                if (example := self._make_example(without_percent(hold), *key))
            ]
            line, errors = np.array([0.0, 1.0]), np.zeros(0)
            if examples:
                features, truth, half_width = map(np.array, zip(*examples, strict=True))
                errors = (truth - features[:, 1]) / np.where(np.isnan(half_width), 1.0, half_width)
                if self.learn:
                    own = np.abs(truth - features[:, 1])
                    prior = np.where(np.isnan(half_width), own, half_width / 2)
                    line, errors = _learn_line(features, truth, float(prior.mean()))
            self._cache[key] = line, np.sort(np.abs(errors))
        return self._cache[key]

    def _make_example(
        self, hold: Hold, cutoff_s: float, horizon_s: float, level: float, positive: bool
    ) -> tuple[FloatArray, float, float] | None:
        """Return features up to the cut-off, later change and half-width for a past hold.

        The result is None if the hold cannot be used.
        """
        settled = measure_settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
        time_s = hold.time_s[hold.time_s <= cutoff_s]
        values = hold.values[None, : time_s.size]
        if np.isnan(settled) or not time_s.size or not np.ptp(values):
            return None
        if positive and min(values.min(), settled) <= 0:
            return None
        found = self.method.predict(time_s, values, horizon_s=horizon_s, level=level)
        unit = _unit(values, positive=positive)
        [features] = self._features(time_s, values, found, unit)
        change = float((settled - values[0, -1]) / unit[0])
        return features, change, float(_half_width(found, unit)[0])

    def _features(
        self, time_s: FloatArray, values: FloatArray, found: SettledEstimate, unit: FloatArray
    ) -> FloatArray:
        """Return a column of ones and the features: predicted changes in multiples of `unit`."""
        forecasts = [np.asarray(found.value)]
        if self.learn:
            fold_s = float(time_s[-1] - time_s[0]) / np.e
            for law in (LogLaw(wait_s=0.1, from_s=0.4), LogLaw(wait_s=fold_s)):
                estimate = law.predict(time_s, values, horizon_s=found.horizon_s, level=found.level)
                forecasts.append(np.asarray(estimate.value))
        changes = [(forecast - values[:, -1]) / unit for forecast in forecasts]
        return np.column_stack([np.ones(len(values)), *changes])


def _unit(values: FloatArray, *, positive: bool) -> FloatArray:
    """Return the unit of changes: the last sample, or the range of signed values."""
    return values[:, -1] if positive else np.maximum(np.ptp(values, axis=1), _TINY)


def _half_width(found: SettledEstimate, unit: FloatArray) -> FloatArray:
    return np.asarray((found.high - found.low) / 2 / unit)


def _learn_line(
    features: FloatArray, truth: FloatArray, prior_error: float
) -> tuple[FloatArray, FloatArray]:
    """Return the weighted line of the experts, and its leave-one-out error for each hold."""
    lines = _fit_experts(features, truth)
    others = [np.arange(truth.size) != k for k in range(truth.size)]
    loo_lines = np.array(
        [_fit_experts(features[k], truth[k]) for k in others if k.any()] or [lines]
    )
    errors = truth - np.einsum("kef,kf->ek", loo_lines, features)
    mean_error = (np.abs(errors).sum(axis=1) + _PRIOR_ERRORS_OF_EXPERTS * prior_error) / (
        truth.size + _PRIOR_ERRORS_OF_EXPERTS
    )
    # Laplace likelihood of the errors, with the best scale for each expert.
    weights = (mean_error.min() / (mean_error + _TINY)) ** truth.size
    weights /= weights.sum()
    return weights @ lines, weights @ errors


def _fit_experts(features: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the experts as lines: the method, and a line and a multiple per feature.

    The slope of a line is shrunk towards 0 by the weight of one hold (ridge), so that with one hold
    the line is a constant. The multiple has the least absolute error.
    """
    features = features[:, 1:]
    n_holds, n_features = features.shape
    lines = np.zeros((1 + 2 * n_features, 1 + n_features))
    lines[0, 1] = 1.0
    sloped, multiples = lines[1 : 1 + n_features], lines[1 + n_features :]
    x, y = features - features.mean(axis=0), truth - truth.mean()
    slopes = x.T @ y / (np.square(x).sum(axis=0) * (1 + 1 / n_holds) + _TINY**2)
    sloped[:, 1:] = np.diag(slopes)
    sloped[:, 0] = truth.mean() - slopes * features.mean(axis=0)
    # The multiple with the least absolute error is the weighted median of the ratios.
    weight = np.abs(features) + _TINY
    ratio = truth[:, None] * np.sign(features) / weight
    order = np.argsort(ratio, axis=0)
    cumulative = np.cumsum(np.take_along_axis(weight, order, axis=0), axis=0)
    median = (cumulative < cumulative[-1] / 2).sum(axis=0)
    columns = np.arange(n_features)
    multiples[:, 1:] = np.diag(ratio[order[median, columns], columns])
    return lines
