"""Gain of one contact relative to the sheet's law, estimated from other force measurements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.force import ForceEstimate
from palpate.measurement import half_width_sds

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
    """Ratio of a contact's force to the force from the sheet's law."""

    #: Mean and standard deviation of ln (true force / force from the law).
    log_mean: float
    log_sd: float
    #: Scatter of ln force that the law's own intervals include.
    law_sd: float

    @classmethod
    def from_calibration(cls, *, law_sd: float, additional_sd: float = 0.0) -> Gain:
        """Return the prior gain from the sheet's calibration, with additional uncertainty.

        >>> round(Gain.from_calibration(law_sd=0.03, additional_sd=0.04).log_sd, 6)
        0.05
        """
        return cls(log_mean=0.0, log_sd=float(np.hypot(law_sd, additional_sd)), law_sd=law_sd)

    def half_width(self, *, level: float) -> float:
        """Return the half-width of the interval of ln gain."""
        return half_width_sds(level) * self.log_sd

    def update(self, measured: MeasuredForce, *, sheet_n: float) -> Gain:
        """Return the gain after a force measurement; `sheet_n`: force from the sheet's law.

        The forces are compared in newtons, because the logarithm of a force with a large
        uncertainty is not meaningful.

        >>> measured = MeasuredForce(force_n=2.2, sd_n=0.2, log_sd=0.0)
        >>> gain = Gain.from_calibration(law_sd=0.1).update(measured, sheet_n=2.0)
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

    def apply_to(self, estimate: ForceEstimate) -> ForceEstimate:
        """Apply the gain to the law's estimate; an estimate of 0 retains its limits.

        >>> law_sd = np.log(2.0) / half_width_sds(0.9)
        >>> raw = ForceEstimate(value=np.array([2.0]), low=np.array([1.0]), high=np.array([4.0]),
        ...     in_range=np.array([True]), level=0.9)
        >>> gain = Gain(log_mean=np.log(1.5), log_sd=law_sd / 2, law_sd=law_sd)
        >>> gain.apply_to(raw).value.round(3).tolist(), gain.apply_to(raw).high.round(3).tolist()
        ([3.0], [4.243])
        """
        quantile = half_width_sds(estimate.level)
        factor, read = float(np.exp(self.log_mean)), estimate.value > 0
        value = np.where(read, estimate.value, 1.0)
        up = self._half_widths(np.log(np.where(read, estimate.high, 1.0) / value), quantile)
        down = self._half_widths(np.log(value / np.maximum(estimate.low, 1e-9 * value)), quantile)
        return ForceEstimate(
            value=factor * estimate.value,
            low=np.where(read & (estimate.low > 0), factor * value * np.exp(-down), 0.0),
            high=np.where(read, factor * value * np.exp(up), estimate.high),
            in_range=estimate.in_range,
            level=estimate.level,
        )

    def _half_widths(self, log_half: FloatArray, quantile: float) -> FloatArray:
        """Return half-widths of ln force, with the gain's uncertainty instead of the law's."""
        rest = np.maximum(log_half**2 - (quantile * self.law_sd) ** 2, 0.0)
        return np.asarray(np.sqrt(rest + (quantile * self.log_sd) ** 2))
