"""Gain of one contact relative to the sheet's law, estimated from other force measurements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

#: Grid of ln gain, in standard deviations of the prior.
_GRID = np.linspace(-4.0, 4.0, 81)
#: Degrees of freedom (Student's t) of the measurement error: gear friction has more outliers than a
#: normal distribution.
_FREEDOM = 4.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MeasuredForce:
    """A force measured without the sheet."""

    #: Force and its standard deviation.
    force_n: float
    sd_n: float
    #: Additional relative error.
    log_sd: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Gain:
    """Ratio of a contact's force to the force from the sheet's law.

    Attributes
    ----------
    log_mean, log_sd : float
        Mean and standard deviation of ln (true force / force from the law).
    law_sd : float
        Standard deviation before any other measurement.
    """

    log_mean: float = 0.0
    log_sd: float = 0.0
    law_sd: float = 0.0

    @classmethod
    def of_law(cls, log_sd: float) -> Gain:
        """Return the gain that only the law of the sheet tells."""
        return cls(log_sd=log_sd, law_sd=log_sd)

    @property
    def is_measured(self) -> bool:
        """Whether it includes a measurement besides the law's."""
        return self.log_sd != self.law_sd

    @property
    def factor(self) -> float:
        """Factor of the force from the law."""
        return math.exp(self.log_mean)

    def update(self, measured: MeasuredForce, *, sheet_n: float) -> Gain:
        """Return the gain after a force measurement; `sheet_n`: force from the sheet's law.

        The forces are compared in newtons, because the logarithm of a force with a large
        uncertainty is not meaningful.

        >>> measured = MeasuredForce(force_n=2.2, sd_n=0.2, log_sd=0.0)
        >>> gain = Gain.of_law(0.1).update(measured, sheet_n=2.0)
        >>> round(gain.log_mean, 2), round(gain.log_sd, 2)
        (0.04, 0.07)
        """
        if not (sheet_n > 0 and self.log_sd > 0):
            return self
        log_gain = self.log_mean + self.log_sd * _GRID
        expected_n = sheet_n * np.exp(log_gain)
        variance = measured.sd_n**2 + (expected_n * measured.log_sd) ** 2
        square = (measured.force_n - expected_n) ** 2 / variance
        log_weight = -0.5 * ((_FREEDOM + 1.0) * np.log1p(square / _FREEDOM) + _GRID**2)
        weight = np.exp(log_weight - log_weight.max())
        weight /= weight.sum()
        mean = float(weight @ log_gain)
        spread = float(np.sqrt(weight @ (log_gain - mean) ** 2))
        return Gain(log_mean=mean, log_sd=spread, law_sd=self.law_sd)
