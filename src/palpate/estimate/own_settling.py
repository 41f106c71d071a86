"""The settled value of a sensor whose own settled holds are at hand.

Whoever calibrates a force law has held a sensor still for 20 s a number of times. Those holds tell
how this sheet settles: how far it still has to go, given how far it went in each part of the
window. A ridge regression learns that, with the forecast of the general prior as one of its terms,
so that few holds fall back on their mean and the prior. It is for the same sensor, read the same
way: time 0 at the actuation, one unit, the fingers as fast as then.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.stats import t as student_t

from palpate.errors import CalibrationError
from palpate.holds import Hold
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import FloatArray, SettledEstimate, Status
from palpate.settling.scoring import settled_value

#: Fewer holds can't show how far their own answers scatter.
FEWEST_HOLDS = 8
#: Times within the window whose values are compared with the last one, as shares of it; the first
#: is used only where the movement is over by then.
_SHARES = (0.25, 0.4, 0.6, 0.8)
_MOVING_S = 0.45
#: Samples whose mean is a value.
_MEAN = 3
#: Weight of the prior that no term matters: as of one hold.
_RIDGE = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class OwnSettling:
    """A predictor learned from settled holds of the same sensor.

    Attributes
    ----------
    holds : tuple of Hold
        At least 8 that reach the horizon, none of them to be predicted.
    prior : Relaxation
        The general predictor, whose forecast is one of the terms.

    Raises
    ------
    CalibrationError
        If there are too few holds.

    Examples
    --------
    Holds that all lose 5 % between 2 s and 20 s:

    >>> time_s = np.arange(1, 301) / 15
    >>> shape = 1 + 0.1 * np.exp(-time_s / 3)
    >>> holds = tuple(Hold(hold_id=str(k), channel=None, time_s=time_s, values=-k * shape)
    ...     for k in range(20, 30))
    >>> method = OwnSettling(holds=holds)
    >>> found = method.predict(time_s[:30], -24.5 * shape[None, :30], horizon_s=20.0, level=0.9)
    >>> round(float(found.value[0]), 1)
    -24.5
    """

    holds: tuple[Hold, ...]
    prior: Relaxation = field(default_factory=Relaxation)

    def __post_init__(self) -> None:
        if len(self.holds) < FEWEST_HOLDS:
            raise CalibrationError(
                f"settling of this sensor: {len(self.holds)} holds, at least {FEWEST_HOLDS} "
                "needed; `palpate calibrate settling` cuts them from recorded grasps"
            )

    @property
    def name(self) -> str:
        """Name in results."""
        return "own"

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict as `Relaxation` does; where a hold's values change sign, its answer stands."""
        general = self.prior.predict(time_s, values, horizon_s=horizon_s, level=level)
        if time_s[-1] >= horizon_s:
            return general
        asked, usable = _terms(time_s, values, np.asarray(general.value))
        terms, target = self._learned(float(time_s[-1]), horizon_s=horizon_s, level=level)
        if len(target) < FEWEST_HOLDS:
            return general
        ahead, deviation = _ridge(terms, target, asked)
        now, reach = _now(values), student_t.ppf(0.5 + level / 2, len(target) - 1)
        status = np.where(usable, np.asarray(general.status), Status.FELL_BACK)
        ends = np.sort([now * np.exp(ahead + side * reach * deviation) for side in (-1, 1)], axis=0)
        return SettledEstimate(
            value=np.where(usable, now * np.exp(ahead), general.value),
            low=np.where(usable, ends[0], general.low),
            high=np.where(usable, ends[1], general.high),
            level=level,
            horizon_s=horizon_s,
            window_s=general.window_s,
            method=self.name,
            status=status,
        )

    def _learned(
        self, window_s: float, *, horizon_s: float, level: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return terms and ln(settled / now) of the calibration holds, seen as far as now."""
        terms, target = [], []
        for hold in self.holds:
            settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
            seen = hold.time_s <= window_s
            if np.isnan(settled) or seen.sum() < _MEAN:
                continue
            time_s, values = hold.time_s[seen], hold.values[None, seen]
            general = self.prior.predict(time_s, values, horizon_s=horizon_s, level=level)
            found, usable = _terms(time_s, values, np.asarray(general.value))
            ratio = settled / float(_now(values)[0])
            if usable[0] and ratio > 0:
                terms.append(found[0])
                target.append(np.log(ratio))
        return np.array(terms), np.array(target)


def _now(values: FloatArray) -> FloatArray:
    return np.asarray(values[:, -_MEAN:].mean(axis=1))


def _terms(
    time_s: FloatArray, values: FloatArray, forecast: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return terms, shape (holds, terms), and which holds have them: ratios need one sign."""
    now, window_s = _now(values), float(time_s[-1])
    places = [int(np.searchsorted(time_s, share * window_s)) for share in _SHARES]
    places = [place for place in places if time_s[place] >= _MOVING_S] or places[-1:]
    before = [values[:, max(place - 1, 0) : place + 2].mean(axis=1) for place in places]
    ratios = np.stack([now / np.where(v == 0, np.nan, v) for v in [*before, forecast]], axis=1)
    usable = (np.nan_to_num(ratios) > 0).all(axis=1) & (now != 0)
    safe = np.where(usable[:, None], ratios, 1.0)
    level = np.log(np.where(now == 0, 1.0, np.abs(now)))
    return np.concatenate([np.log(safe), level[:, None]], axis=1), usable


def _ridge(terms: FloatArray, target: FloatArray, asked: FloatArray) -> tuple[FloatArray, float]:
    """Return answers, and the standard deviation of answers on holds left out of the fit."""
    middle, spread = terms.mean(axis=0), np.maximum(terms.std(axis=0), 1e-9)
    scaled = np.column_stack([np.ones(len(terms)), (terms - middle) / spread])
    penalty = _RIDGE * np.eye(scaled.shape[1])
    penalty[0, 0] = 0.0
    inverse = np.linalg.inv(scaled.T @ scaled + penalty)
    weights = inverse @ scaled.T @ target
    # The error on a hold left out follows from the fit with it (the hat matrix).
    leverage = np.einsum("ni,ij,nj->n", scaled, inverse, scaled)
    left_out = (target - scaled @ weights) / np.maximum(1.0 - leverage, 1e-6)
    asked_scaled = np.column_stack([np.ones(len(asked)), (asked - middle) / spread])
    return asked_scaled @ weights, float(np.sqrt(np.mean(left_out**2)))
