"""The sensor's own settled holds: which rule fits them, and how far it is off.

The experts are the general predictor as it is, a constant multiple of the last reading, and lines
and multiples of one thing that a hold shows: the general forecast, the log law, the pace of the
last e-fold. Each is fitted to the past holds, weighed by its errors where a hold is left out of its
own fit, and the interval reaches as far as those errors do (Lei et al., "Distribution-Free
Predictive Inference for Regression", JASA 113, 2018), drawn towards the general interval while
holds are few.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.holds import SETTLED_WINDOW_S, Hold, settled_value
from palpate.settling.conformal import PROVING_HOLDS
from palpate.settling.log_law import LogLaw
from palpate.settling.percent import without_percent
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate, Status

#: The latest holds are used: a sensor wears, and more sharpen nothing.
MOST_HOLDS = 60
#: The general interval counts as this many errors of own holds, and half of it as this many errors
#: of every expert.
_GENERAL_ERRORS, _GENERAL_HOLDS = 3.0, 2.0
#: Cut-offs that are remembered.
_REMEMBERED = 64
_TINY = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Shown:
    """What holds show up to a cut-off, in ln of the last reading, or in units of their range.

    `features`, shape (n_holds, 3): changes to come by the general forecast, the log law and the
    pace; `below`, `above`, shape (n_holds,): reach of the general interval; `unit` of each hold.
    """

    features: FloatArray
    below: FloatArray
    above: FloatArray
    unit: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Learned:
    """Experts as lines, shape (n_experts, 1 + n_features), their weights, and sorted |errors|."""

    lines: FloatArray
    weights: FloatArray
    errors: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnRelaxation:
    """`Relaxation` and simple rules, weighed and widened by settled holds of the same sensor.

    Attributes
    ----------
    holds : tuple of Hold
        Past holds in the order of recording; those that reach the horizon count, none of them is
        to be predicted.
    general : Relaxation
        What is known without them.

    Raises
    ------
    CalibrationError
        If there is no hold.

    Examples
    --------
    Holds that all lose 5 % between 2 s and 20 s:

    >>> time_s = np.arange(1, 301) / 15
    >>> shape = 1 + 0.1 * np.exp(-time_s / 3)
    >>> holds = tuple(Hold(hold_id=str(k), channel=None, time_s=time_s, values=k * shape)
    ...     for k in range(20, 30))
    >>> method = OwnRelaxation(holds=holds)
    >>> found = method.predict(time_s[:30], 24.5 * shape[None, :30], horizon_s=20.0, level=0.9)
    >>> round(float(found.value[0]), 1), found.status[0].value
    (24.5, 'ok')
    """

    holds: tuple[Hold, ...]
    general: Relaxation = field(default_factory=Relaxation)
    _known: dict[tuple[float, float, bool], _Learned | None] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def __post_init__(self) -> None:
        if not self.holds:
            raise CalibrationError(
                "no hold to learn from; `palpate calibrate settling` cuts them from recordings"
            )

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return self.general.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`."""
        found = self.general.predict(time_s, values, horizon_s=horizon_s, level=level)
        positive = bool((values > 0).all())
        key = (float(time_s[-1]), horizon_s, positive)
        if key not in self._known:
            if len(self._known) >= _REMEMBERED:
                self._known.clear()
            self._known[key] = self._learn(key[0], horizon_s=horizon_s, positive=positive)
        learned = self._known[key]
        if learned is None or time_s[-1] >= horizon_s - SETTLED_WINDOW_S / 2:
            return found
        shown = _show(time_s, values, found, horizon_s=horizon_s, positive=positive)
        change = _with_one(shown.features) @ (learned.weights @ learned.lines)
        holds = learned.errors.size
        rank = min(int(np.ceil((holds + 1) * level)), holds)
        reach = holds * learned.errors[rank - 1]
        total = holds + _GENERAL_ERRORS
        ends = [
            change - (reach + _GENERAL_ERRORS * shown.below) / total,
            change,
            change + (reach + _GENERAL_ERRORS * shown.above) / total,
        ]
        last = values[:, -1]
        low, value, high = (
            last * np.exp(end) if positive else last + shown.unit * end for end in ends
        )
        status = np.asarray(found.status).copy()
        if holds >= PROVING_HOLDS:
            status[status != Status.NOT_SETTLING] = Status.OK
        return replace(found, low=low, value=value, high=high, status=status)

    def _learn(self, cutoff_s: float, *, horizon_s: float, positive: bool) -> _Learned | None:
        rows = [
            row
            for hold in map(without_percent, self.holds[-MOST_HOLDS:])
            if (row := self._past(hold, cutoff_s, horizon_s=horizon_s, positive=positive))
        ]
        if not rows:
            return None
        features = np.concatenate([shown.features for shown, _ in rows])
        truth = np.array([change for _, change in rows])
        general = np.mean([(shown.below + shown.above) / 4 for shown, _ in rows])
        lines = _fit(features, truth)
        others = [np.arange(truth.size) != k for k in range(truth.size)]
        left_out = np.array([_fit(features[k], truth[k]) for k in others if k.any()] or [lines])
        errors = truth - np.einsum("kef,kf->ek", left_out, _with_one(features))
        size = (np.abs(errors).sum(axis=1) + _GENERAL_HOLDS * general) / (
            truth.size + _GENERAL_HOLDS
        )
        # The likelihood of errors of this mean size (Laplace), each expert at its own best.
        weights = (size.min() / (size + _TINY)) ** truth.size
        weights /= weights.sum()
        return _Learned(lines=lines, weights=weights, errors=np.sort(np.abs(weights @ errors)))

    def _past(
        self, hold: Hold, cutoff_s: float, *, horizon_s: float, positive: bool
    ) -> tuple[_Shown, float] | None:
        """Return what a past hold showed up to the cut-off, and its change after that."""
        settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
        seen = hold.time_s <= cutoff_s
        values = hold.values[None, seen]
        if np.isnan(settled) or not seen.any() or not np.ptp(values):
            return None
        if positive and min(values.min(), settled) <= 0:
            return None
        time_s = hold.time_s[seen]
        found = self.general.predict(time_s, values, horizon_s=horizon_s, level=0.9)
        shown = _show(time_s, values, found, horizon_s=horizon_s, positive=positive)
        return shown, float(_changes(np.array([settled]), values, shown.unit, positive=positive)[0])


def _show(
    time_s: FloatArray,
    values: FloatArray,
    general: SettledEstimate,
    *,
    horizon_s: float,
    positive: bool,
) -> _Shown:
    unit = np.maximum(np.ptp(values, axis=1), _TINY)
    last_fold_s = float(time_s[-1] - time_s[0]) * (1 - 1 / np.e)
    laws = (LogLaw(wait_s=0.1, from_s=0.4), LogLaw(wait_s=last_fold_s / (np.e - 1), from_s=0.2))
    samples = np.log(values / values[:, -1:]) if positive else values - values[:, -1:]
    by_law = [
        law.predict(time_s, samples, horizon_s=horizon_s, level=general.level).value for law in laws
    ]
    forecast, low, high = (
        _changes(np.asarray(end), values, unit, positive=positive)
        for end in (general.value, general.low, general.high)
    )
    scale = 1.0 if positive else unit
    return _Shown(
        features=np.column_stack([forecast, *(np.asarray(change) / scale for change in by_law)]),
        below=forecast - low,
        above=high - forecast,
        unit=unit,
    )


def _changes(
    ends: FloatArray, values: FloatArray, unit: FloatArray, *, positive: bool
) -> FloatArray:
    """Return changes since the last sample, in ln or in units of the range."""
    last = values[:, -1]
    return np.asarray(np.log(ends / last) if positive else (ends - last) / unit)


def _with_one(features: FloatArray) -> FloatArray:
    return np.column_stack([np.ones(len(features)), features])


def _fit(features: FloatArray, truth: FloatArray) -> FloatArray:
    """Return the experts as lines: general, constant, and for each feature a line and a multiple.

    The slope of a line counts one hold without any, so it takes several to show one (ridge); the
    multiple is that of the least absolute error.
    """
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
