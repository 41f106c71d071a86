"""How far a sheet still creeps after a step, as its own force calibration showed.

A predictor for sheets in general has a wide prior on the creep of this one. The calibration has
seen it: at every force at which it stood still, the reading soon after the last step and the
settled one are on file. In between, creep is about even in the logarithm of time. Without it the
force of soft fingers errs by 23 % instead of 13 % in the median and their answers at 4 N come 2 s
later (60 simulated grasps a row, level `lab`); rigid fingers are hardly affected.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.estimate.measurement import Measurement

#: Fewer holds don't show how much the creep of a sheet scatters.
_FEWEST = 5
#: A grasp loads the sheet in other steps than its calibration did, and an object may relax in the
#: hand: creep may differ by half of itself for these reasons.
_OTHERWISE = 0.5
#: No reading at the horizon itself is better known than this (ln).
_LEAST_SD = 0.005
#: From a normal distribution's median absolute deviation to its standard deviation.
_MAD = 1.4826


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetCreep:
    """Growth of one sheet's reading from soon after a step until it counts as settled."""

    #: Of ln(settled reading / early reading) over the holds of the calibration.
    log_mean: float
    log_sd: float
    #: When the two were read, from the start of the step.
    early_s: float
    settled_s: float

    @classmethod
    def fit(
        cls, early: FloatArray, *, settled: FloatArray, early_s: float, settled_s: float
    ) -> SheetCreep | None:
        """Learn from the readings of holds, shape (n,) each; None from too few.

        Medians: a placement near a pixel's threshold shows little of the others.

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

    def join(self, forecast: Measurement, *, now: float, since_s: float) -> Measurement:
        """Return a forecast of the settled reading with this creep weighed in.

        Both are blind to what the object does, so together they are trusted no more than the
        better of them.

        `forecast`: by a predictor for sheets in general.
        `now`, `since_s`: the present reading, and the time since the last movement began.

        >>> creep = SheetCreep(log_mean=0.2, log_sd=0.0, early_s=0.4, settled_s=20.0)
        >>> predicted = Measurement(value=1.0, low=0.8, high=1.2, unit="reading")
        >>> found = creep.join(predicted, now=1.0, since_s=0.4 * 50**0.5)
        >>> round(found.value, 2), found.high - found.value < 0.1
        (1.09, True)
        """
        if not (now > 0 and forecast.middle > 0):
            return forecast
        reach = float(ndtri(0.5 + forecast.level / 2))
        gone = math.log(max(since_s, self.early_s) / self.early_s)
        left = max(1.0 - gone / math.log(self.settled_s / self.early_s), 0.0)
        mine = now * math.exp(left * self.log_mean)
        doubt = left * math.hypot(self.log_sd, _OTHERWISE * self.log_mean)
        own_sd = max(doubt, _LEAST_SD)
        general_sd = max((forecast.high - forecast.low) / (2 * reach * forecast.middle), _LEAST_SD)
        weight = general_sd**2 / (own_sd**2 + general_sd**2)
        value = math.exp((1 - weight) * math.log(forecast.middle) + weight * math.log(mine))
        half = reach * min(own_sd, general_sd)
        return Measurement(
            value=value,
            low=value * math.exp(-half),
            high=value * math.exp(half),
            unit=forecast.unit,
            level=forecast.level,
            status=forecast.status,
        )
