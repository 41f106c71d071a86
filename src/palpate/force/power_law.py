"""Baseline: a power law of the summed excess conductance, as usual for such sheets.

Its input is the excess conductance G/G0 - 1 summed over pixels, which hardly depends on the
distribution of the load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.special import stdtrit

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError
from palpate.force.line_law import (
    MIN_PAIRS,
    ForceEstimate,
    check_pairs,
    law_sd,
    require_pairs,
)

#: Candidates for the force below which the scatter is constant in newtons instead of percent, as
#: multiples of the calibration's weakest force; 0 for a scatter in percent at all forces.
_WEAK_RATIOS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerForceLaw:
    """force = offset + scale * excess ** exponent.

    The scatter is proportional to the force, plus a constant part for weak forces near the sheet's
    threshold, so that weak forces do not widen the intervals of firm grips.

    Attributes
    ----------
    coefficients : tuple of float
        ln scale (ln N), exponent, offset (N). The offset is the detection threshold of the sheet;
        0 if the calibration does not require an offset.
    covariance : tuple of tuple of float, shape (3, 3)
        Covariance of the coefficients.
    range : tuple of float
        Smallest and largest excess conductance of the calibration.
    residual_sd : float
        Scatter of ln force about the law, for firm forces.
    pairs : int
        Calibration pairs.
    floor_n : float
        Scatter of weak forces, newtons.
    """

    coefficients: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    range: tuple[float, float]
    residual_sd: float
    pairs: int
    floor_n: float = 0.0

    @classmethod
    def fit(cls, excess: ArrayLike, *, force_n: ArrayLike) -> PowerForceLaw:
        """Fit the law to settled calibration pairs, robustly, in ln force.

        Parameters
        ----------
        excess : array_like, shape (n_pairs,)
            Excess conductance G/G0 - 1 summed over pixels. Pairs without load or response are
            ignored, because they have no logarithm.
        force_n : array_like, shape (n_pairs,)
            Reference forces, newtons.

        Raises
        ------
        CalibrationError
            If the pairs are insufficient: too few, a single load, or a reading that falls with the
            load.

        Examples
        --------
        >>> law = PowerForceLaw.fit([1.0, 4.0, 9.0, 16.0, 25.0], force_n=[1.0, 2, 3, 4, 5])
        >>> law.force_n([4.0, 100.0]).value.round(3).tolist()
        [2.0, 10.0]
        >>> law.force_n([4.0, 100.0]).in_range.tolist()
        [True, False]
        """
        x, y = check_pairs(excess, force_n)
        keep = (x > 0) & (y > 0)
        x, y = require_pairs(x[keep], y[keep])
        log_x, log_y = np.log(x), np.log(y)
        if _robust_line(log_x, log_y)[0] <= 0:
            raise CalibrationError(
                "force calibration: the excess conductance does not rise with the load; "
                "check the wiring, the divider's leg and that the rest was taken unloaded"
            )
        weight, residual_sd, floor_n = np.ones_like(log_y), 0.0, 0.0
        # Two iterations, because the scatter depends on the law, and the law's weights on scatter.
        for _ in range(2):
            plain = _fit_log(log_x, log_y, weight, with_offset=False)
            offset = (
                _fit_log(log_x, log_y, weight, with_offset=True) if len(x) > MIN_PAIRS else plain
            )
            coefficients, covariance, errors, _ = min(plain, offset, key=lambda fit: fit[3])
            weight, residual_sd, floor_n = _scatter(
                errors, y, used=int(np.count_nonzero(coefficients))
            )
        return cls(
            coefficients=(float(coefficients[0]), float(coefficients[1]), float(coefficients[2])),
            covariance=tuple(map(tuple, covariance.tolist())),
            range=(float(x.min()), float(x.max())),
            residual_sd=residual_sd,
            pairs=len(x),
            floor_n=floor_n,
        )

    def force_n(self, excess: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        """Return the force for each excess conductance (array of any shape).

        See `ForceEstimate`. With no response (excess 0 or less) the force is 0, and its upper limit
        is that at the smallest calibrated reading.
        """
        x = np.asarray(excess, dtype=float)
        responds = x > 0
        log_x = np.log(np.where(responds, x, self.range[0]))
        log_scale, exponent, offset = self.coefficients
        grown = np.exp(log_scale + exponent * log_x)
        value = offset + grown
        gradient = np.stack([grown, grown * log_x, np.ones_like(grown)], axis=-1) / value[..., None]
        sd = law_sd(gradient, covariance=self.covariance, residual_sd=self.residual_sd)
        freedom = self.pairs - (3 if offset > 0 else 2)
        quantile = float(stdtrit(freedom, 0.5 + level / 2))
        spread, weak_n = np.exp(quantile * sd), quantile * self.floor_n
        low = value - np.hypot(value - value / spread, weak_n)
        return ForceEstimate(
            value=np.where(responds, value, 0.0),
            low=np.where(responds, np.maximum(low, 0.0), 0.0),
            high=value + np.hypot(value * spread - value, weak_n),
            in_range=(x >= self.range[0]) & (x <= self.range[1]),
            level=level,
        )


def _scatter(
    errors: FloatArray, force_n: FloatArray, *, used: int
) -> tuple[FloatArray, float, float]:
    """Return weights of ln force, its scatter for firm forces, and the scatter in newtons.

    The variance of ln force is modelled as sd**2 (1 + (weak / force)**2). The likeliest candidate
    for `weak` is selected; BIC penalises values above 0.
    """
    freedom, best = len(errors) - used, (np.inf, np.ones_like(errors), 0.0, 0.0)
    for weak_n in np.array(_WEAK_RATIOS) * float(force_n.min()):
        factor = 1.0 + (weak_n / force_n) ** 2
        sd = float(np.sqrt(max(float(np.sum(errors**2 / factor)) / freedom, 1e-24)))
        badness = len(errors) * np.log(sd) + 0.5 * float(np.log(factor).sum())
        badness += 0.5 * np.log(len(errors)) * (weak_n > 0)
        if badness < best[0]:
            best = (badness, 1.0 / np.sqrt(factor), sd, sd * float(weak_n))
    return best[1:]


def _robust_line(x: FloatArray, y: FloatArray) -> tuple[float, float]:
    """Return slope and intercept of the Theil-Sen estimator, which is robust to outliers.

    Equivalent to `scipy.stats.theilslopes`, which is avoided because of its import time.

    >>> from scipy.stats import theilslopes
    >>> x, y = np.array([0.0, 1.0, 2.0, 3.0, 3.0]), np.array([1.0, 2.9, 5.2, 70.0, 7.1])
    >>> bool(np.allclose(_robust_line(x, y), theilslopes(y, x)[:2]))
    True
    """
    run, rise = x[:, None] - x, y[:, None] - y
    later = run > 0
    slope = float(np.median(rise[later] / run[later])) if later.any() else 0.0
    return slope, float(np.median(y)) - slope * float(np.median(x))


def _fit_log(
    log_x: FloatArray, log_y: FloatArray, weight: FloatArray, *, with_offset: bool
) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Fit the law; return coefficients, covariance, unweighted residuals of ln force, and BIC."""
    count = 3 if with_offset else 2

    def residuals(p: FloatArray) -> FloatArray:
        offset = p[2] if with_offset else 0.0
        log_force = np.log(offset + np.exp(p[0] + p[1] * log_x))
        return np.asarray(weight * (log_force - log_y))

    slope, intercept = _robust_line(log_x, log_y)
    weakest = float(np.exp(log_y.min()))
    start = np.array([intercept, slope, 0.2 * weakest])[:count]
    upper = np.array([np.inf, np.inf, weakest])[:count]
    scale = max(2.5 * 1.48 * float(np.median(np.abs(residuals(start)))), 1e-6)
    found = least_squares(
        residuals, start, bounds=([-np.inf, 0.0, 0.0][:count], upper), loss="cauchy", f_scale=scale
    )
    errors = residuals(found.x)
    jacobian = np.asarray(found.jac, dtype=float)
    squares = float(errors @ errors)
    freedom = len(log_x) - count
    covariance = np.zeros((3, 3))
    # pinv: an offset on its bound has no gradient to invert.
    covariance[:count, :count] = np.linalg.pinv(jacobian.T @ jacobian) * squares / freedom
    coefficients = np.zeros(3)
    coefficients[:count] = found.x
    bic = len(log_x) * np.log(max(float(found.cost), 1e-24)) + count * np.log(len(log_x))
    return coefficients, covariance, errors / weight, float(bic)
