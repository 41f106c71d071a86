"""Creep of one sheet after a step, measured in its force calibration.

A general predictor has a wide prior for the creep of a sheet. The calibration measures the creep of
each hold, from the reading soon after the last step to the settled reading. Between these readings,
creep is approximately uniform in the logarithm of time. Without this information, the median force
error of soft fingers is 23 % instead of 13 %, and their results at 4 N are 2 s later (60 simulated
grasps per row, level `lab`). Rigid fingers are hardly affected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.measurement import Measurement

#: Fewest holds for an estimate of the scatter of creep.
_FEWEST = 5
#: Relative uncertainty of creep in a grasp, because its steps differ from the calibration's and the
#: object may relax.
_CREEP_SD = 0.5
#: Smallest uncertainty of a settled reading (ln).
_LEAST_SD = 0.005
#: Ratio of standard deviation to median absolute deviation of a normal distribution.
_MAD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetCreep:
    """Rise of one sheet's reading from soon after a step until it has settled."""

    #: Mean and scatter of ln(settled reading / early reading) over the holds of the calibration.
    log_mean: float
    log_sd: float
    #: Times of the two readings after the start of the step.
    early_s: float
    settled_s: float

    @classmethod
    def fit(
        cls, early: FloatArray, *, settled: FloatArray, early_s: float, settled_s: float
    ) -> SheetCreep | None:
        """Fit to the readings of holds, each of shape (n,); None with too few holds.

        Medians are used, because a placement near a pixel's threshold can be an outlier.

        >>> early = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
        >>> creep = SheetCreep.fit(early, settled=1.2 * early, early_s=0.4, settled_s=20.0)
        >>> round(float(np.exp(creep.log_mean)), 3), round(creep.log_sd, 3)
        (1.2, 0.0)
        """
        read = (early > 0) & (settled > 0)
        if np.count_nonzero(read) < _FEWEST:
            return None
        log_ratio = np.log(settled[read] / early[read])
        mean = float(np.median(log_ratio))
        return cls(
            log_mean=mean,
            log_sd=_MAD * float(np.median(np.abs(log_ratio - mean))),
            early_s=early_s,
            settled_s=settled_s,
        )

    def combine(self, forecast: Measurement, *, now: float, since_s: float) -> Measurement:
        """Combine a forecast of the settled reading with this sheet's creep.

        Neither includes the object's relaxation, so the combined uncertainty is that of the better
        one.

        `forecast`: forecast of a general predictor.
        `now`, `since_s`: present reading, and time since the start of the last movement.

        >>> creep = SheetCreep(log_mean=0.2, log_sd=0.0, early_s=0.4, settled_s=20.0)
        >>> predicted = Measurement(value=1.0, low=0.8, high=1.2, unit="reading")
        >>> found = creep.combine(predicted, now=1.0, since_s=0.4 * 50**0.5)
        >>> round(found.value, 2), found.high - found.value < 0.1
        (1.09, True)
        """
        if not (now > 0 and forecast.middle > 0):
            return forecast
        elapsed = math.log(max(since_s, self.early_s) / self.early_s)
        remaining = max(1.0 - elapsed / math.log(self.settled_s / self.early_s), 0.0)
        own = now * math.exp(remaining * self.log_mean)
        own_sd = max(remaining * math.hypot(self.log_sd, _CREEP_SD * self.log_mean), _LEAST_SD)
        general_sd = max(forecast.relative_sd, _LEAST_SD)
        weight = general_sd**2 / (own_sd**2 + general_sd**2)
        value = math.exp((1 - weight) * math.log(forecast.middle) + weight * math.log(own))
        return Measurement.from_log_sd(
            value,
            log_sd=min(own_sd, general_sd),
            unit=forecast.unit,
            level=forecast.level,
            status=forecast.status,
        )
