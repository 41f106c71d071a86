"""Relative changes in percent as ratios: R / R_rest = 1 + percent / 100.

Rest is at 0 % and nothing falls below -100 %, so this ratio is positive like ohm, has the shapes
of ohm and no scale that matters. Without it a reading near -100 % is a number like any other, and
the little that is left of the resistance is lost in the interval.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.arrays import FloatArray
from palpate.holds import Hold
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettledEstimate, SettlingMethod

#: The only unit that a predictor must be given.
PERCENT = "percent"


@dataclass(frozen=True, slots=True, kw_only=True)
class InPercent:
    """A method for holds in percent, made of one for holds of any other unit.

    >>> import numpy as np
    >>> time_s = np.arange(0.0, 2.5, 0.1)
    >>> left = 0.04 + 0.02 * np.exp(-time_s)
    >>> method = InPercent(method=Relaxation())
    >>> found = method.predict(time_s, 100 * (left - 1)[None], horizon_s=20.0, level=0.9)
    >>> bool(-100 < found.low[0] < found.value[0] < found.high[0] < -95)
    True
    """

    #: Predicts the ratio to the resistance at rest.
    method: SettlingMethod

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return self.method.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`."""
        ratio = self.method.predict(time_s, of_rest(values), horizon_s=horizon_s, level=level)
        return as_percent(ratio)


def for_hold(method: SettlingMethod, *, unit: str | None, loading_s: float) -> SettlingMethod:
    """Return the method for the known facts of a hold: unit and loading time."""
    if loading_s > 0 and isinstance(method, Relaxation):
        method = replace(method, loading_s=loading_s)
    return InPercent(method=method) if unit == PERCENT else method


def of_rest(percent: FloatArray) -> FloatArray:
    """Return the fraction of the resistance at rest, any shape."""
    return 1.0 + percent / 100.0


def as_percent(ratio: SettledEstimate) -> SettledEstimate:
    """Return an estimate of such a fraction in percent."""
    value, low, high = (100.0 * (end - 1.0) for end in (ratio.value, ratio.low, ratio.high))
    return replace(ratio, value=value, low=low, high=high)


def without_percent(hold: Hold) -> Hold:
    """Return the hold in fractions of rest if it is in percent."""
    if hold.unit != PERCENT:
        return hold
    return replace(hold, values=of_rest(hold.values), unit=None)
