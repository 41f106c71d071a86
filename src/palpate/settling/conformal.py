"""Intervals from calibration holds for methods that have none of their own (split conformal).

A method's errors on calibration holds, in units of the change that each hold had shown by the
cut-off, are as good a guess of its next error as any: the interval reaches as far as the given
share of them does. It promises the level only for holds like the calibration holds.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold
from palpate.settling.percent import without_percent
from palpate.settling.result import SettledEstimate, SettlingMethod
from palpate.settling.scoring import settled_value
from palpate.signal.transient import peak_index

#: Cut-offs at which errors are taken, s; between them the quantile is interpolated in log time.
CUTOFFS_S = (0.5, 1.0, 1.75, 2.5, 3.5, 5.0, 7.0, 10.0, 14.0)


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
    #: For each, the absolute errors as multiples of the change seen by then, sorted.
    errors: tuple[FloatArray, ...]

    @property
    def name(self) -> str:
        """Name of the method itself."""
        return self.method.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict, with intervals; their ends are NaN where the calibration holds were too few."""
        estimate = self.method.predict(time_s, values, horizon_s=horizon_s, level=level)
        change = _change_seen(values)
        change = np.where(change > 0, change, np.nan)
        reach = self._reach(float(time_s[-1]), level=level) * change
        return replace(estimate, low=estimate.value - reach, high=estimate.value + reach)

    def _reach(self, cutoff_s: float, *, level: float) -> float:
        """Return how many times the change seen the interval reaches to either side."""
        if not self.cutoff_s.size:
            return float("nan")
        quantiles = [_conformal_quantile(errors, level=level) for errors in self.errors]
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
            found = method.predict(hold.time_s[seen], values, horizon_s=horizon_s, level=0.5)
            change = float(_change_seen(values)[0])
            errors[cutoff_s].append(abs(float(found.hold(0).value) - settled) / change)
    kept = {cutoff_s: np.sort(found) for cutoff_s, found in errors.items() if found}
    return Conformal(method=method, cutoff_s=np.array(list(kept)), errors=tuple(kept.values()))


def _change_seen(values: FloatArray) -> FloatArray:
    """Return how far each hold has come since its peak."""
    peaks = values[np.arange(len(values)), peak_index(values)]
    change: FloatArray = np.abs(peaks - values[:, -1])
    return change


def _conformal_quantile(errors: FloatArray, *, level: float) -> float:
    """Return the error that a new one exceeds with probability 1 - level at most."""
    rank = int(np.ceil((errors.size + 1) * level))
    return float(errors[rank - 1]) if rank <= errors.size else float("nan")
