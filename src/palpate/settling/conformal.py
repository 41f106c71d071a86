"""Intervals from calibration holds (split conformal), for methods with intervals and without.

A method's errors on calibration holds, in units of its own interval or else of the change that each
hold had shown by the cut-off, are as good a guess of its next error as any: the interval reaches as
far as the given share of them does. It promises the level only for holds like those.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.holds import Hold, settled_value
from palpate.settling.percent import without_percent
from palpate.settling.result import SettledEstimate, SettlingMethod, Status
from palpate.signal.transient import peak_index

#: Cut-offs at which errors are taken, s; between them the quantile is interpolated in log time.
CUTOFFS_S = (0.5, 1.0, 1.75, 2.5, 3.5, 5.0, 7.0, 10.0, 14.0)


#: A method's own interval counts as this many calibration errors that fill it.
OWN_ERRORS = 10.0
#: From this many calibration holds on, their errors prove an interval.
PROVING_HOLDS = 6
#: Errors are in units of the interval of this level.
_UNIT_LEVEL = 0.9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Conformal:
    """A method with intervals as wide as its errors on calibration holds were.

    Source: V. Vovk, A. Gammerman and G. Shafer, "Algorithmic Learning in a Random World" (2005),
    section 4.2.
    """

    #: What predicts.
    method: SettlingMethod
    #: Shape (n_cutoffs,). Cut-offs that calibration holds had samples for, increasing.
    cutoff_s: FloatArray
    #: For each, the absolute errors in units of the reach of the interval, sorted.
    errors: tuple[FloatArray, ...]

    @property
    def name(self) -> str:
        """Name of the method itself."""
        return self.method.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict, with intervals; their ends are NaN where the calibration holds were too few."""
        estimate = self.method.predict(time_s, values, horizon_s=horizon_s, level=_UNIT_LEVEL)
        below, above, own = _reach(estimate, values)
        times = self._times(float(time_s[-1]), level=level, own=own)
        status = np.asarray(estimate.status).copy()
        if self.errors and self.errors[-1].size >= PROVING_HOLDS:
            status[status == Status.UNPROVEN] = Status.OK
        return replace(
            estimate,
            low=estimate.value - times * below,
            high=estimate.value + times * above,
            level=level,
            status=status,
        )

    def _times(self, cutoff_s: float, *, level: float, own: bool) -> float:
        """Return how many units the interval reaches to either side."""
        default = float(ndtri((1 + level) / 2) / ndtri((1 + _UNIT_LEVEL) / 2))
        if not self.cutoff_s.size:
            return default if own else float("nan")
        quantiles = [_conformal_quantile(errors, level=level) for errors in self.errors]
        if own:
            quantiles = [
                (e.size * (e[-1] if np.isnan(q) else q) + OWN_ERRORS * default)
                / (e.size + OWN_ERRORS)
                for e, q in zip(self.errors, quantiles, strict=True)
            ]
        log_cutoff = np.log(max(cutoff_s, self.cutoff_s[0]))
        return float(np.interp(log_cutoff, np.log(self.cutoff_s), quantiles))


def calibrate(method: SettlingMethod, holds: Iterable[Hold], *, horizon_s: float) -> Conformal:
    """Return a method with intervals from its errors on calibration holds.

    Parameters
    ----------
    method : SettlingMethod
        Predicts as before.
    holds : iterable of Hold
        Those that reach the horizon count; for a level of 0.9 at least nine must.
    horizon_s : float
        Time of the settled value.

    Examples
    --------
    >>> from palpate.settling.recorded import Recorded
    >>> time_s = np.arange(0.0, 21.0, 0.25)
    >>> holds = [
    ...     Hold(hold_id="a", channel=None, time_s=time_s, values=9 - np.log(time_s + origin_s))
    ...     for origin_s in np.linspace(0.2, 1.0, 20)
    ... ]
    >>> method = calibrate(Recorded(), holds, horizon_s=20.0)
    >>> known = holds[9].values[None, time_s <= 2.5]
    >>> found = method.predict(time_s[time_s <= 2.5], known, horizon_s=20.0, level=0.9)
    >>> bool(found.low[0] < holds[9].values[80] < found.high[0])
    True
    """
    errors: dict[float, list[float]] = {cutoff_s: [] for cutoff_s in CUTOFFS_S}
    for hold in map(without_percent, holds):
        settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
        for cutoff_s in CUTOFFS_S:
            seen = hold.time_s <= cutoff_s
            values = hold.values[None, seen]
            if cutoff_s >= horizon_s or np.isnan(settled) or not seen.any() or not np.ptp(values):
                continue
            found = method.predict(
                hold.time_s[seen], values, horizon_s=horizon_s, level=_UNIT_LEVEL
            )
            below, above, _ = _reach(found, values)
            error = settled - float(found.hold(0).value)
            reach = float((above if error > 0 else below)[0])
            if reach > 0:
                errors[cutoff_s].append(abs(error) / reach)
    kept = {cutoff_s: np.sort(found) for cutoff_s, found in errors.items() if found}
    return Conformal(method=method, cutoff_s=np.array(list(kept)), errors=tuple(kept.values()))


def _reach(estimate: SettledEstimate, values: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """Return the unit of errors below and above, and whether it is the method's own interval.

    Without an interval it is the change since the peak; NaN where there was none.
    """
    below = np.asarray(estimate.value - estimate.low)
    above = np.asarray(estimate.high - estimate.value)
    if np.isfinite(below).all():
        return below, above, True
    change = np.abs(values[np.arange(len(values)), peak_index(values)] - values[:, -1])
    change = np.where(change > 0, change, np.nan)
    return change, change, False


def _conformal_quantile(errors: FloatArray, *, level: float) -> float:
    """Return the error that a new one exceeds with probability 1 - level at most."""
    rank = int(np.ceil((errors.size + 1) * level))
    return float(errors[rank - 1]) if rank <= errors.size else float("nan")
