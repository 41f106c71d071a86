"""Conversion between percent and ratio: R / R_rest = 1 + percent / 100.

Rest is 0 % and the lower bound is -100 %. The ratio is therefore positive and has the same curve
shapes as a resistance. A method for signed values would ignore the bound, and its interval near
-100 % would be larger than the remaining resistance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from palpate.arrays import FloatArray
from palpate.holds import Hold
from palpate.settling.result import SettledEstimate, SettlingMethod

#: The only unit that changes a prediction.
PERCENT = "percent"


@dataclass(frozen=True, slots=True, kw_only=True)
class InPercent:
    """A method for holds in percent, based on a method for positive values.

    >>> import numpy as np
    >>> from palpate.settling.relaxation import Relaxation
    >>> time_s = np.arange(0.0, 2.5, 0.1)
    >>> ratio = 0.04 + 0.02 * np.exp(-time_s)
    >>> method = InPercent(method=Relaxation())
    >>> found = method.predict(time_s, 100 * (ratio - 1)[None], horizon_s=20.0, level=0.9)
    >>> bool(-100 < found.low[0] < found.value[0] < found.high[0] < -90)
    True
    """

    #: Predicts the ratio to the rest resistance.
    method: SettlingMethod

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        return self.method.name

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon; see `SettlingMethod.predict`."""
        ratio = self.method.predict(
            time_s, percent_to_ratio(values), horizon_s=horizon_s, level=level
        )
        low, value, high = (100.0 * (end - 1.0) for end in (ratio.low, ratio.value, ratio.high))
        return replace(ratio, low=low, value=value, high=high)


def adapt_method(method: SettlingMethod, *, unit: str | None) -> SettlingMethod:
    """Return the method adapted to a hold's unit."""
    return InPercent(method=method) if unit == PERCENT else method


def percent_to_ratio(percent: FloatArray) -> FloatArray:
    """Convert relative changes in percent to ratios to the rest resistance."""
    return 1.0 + percent / 100.0


def without_percent(hold: Hold) -> Hold:
    """Return a hold in percent as ratios to rest; return other holds unchanged."""
    if hold.unit != PERCENT:
        return hold
    return replace(hold, values=percent_to_ratio(hold.values), unit=None)
