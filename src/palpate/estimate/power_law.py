"""A power law from the excess conductance to force, with the detection threshold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.stats import t as student_t
from scipy.stats import theilslopes

from palpate.errors import CalibrationError
from palpate.estimate.force_pairs import (
    MIN_PAIRS,
    FloatArray,
    ForceEstimate,
    checked_pairs,
    enough_pairs,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PowerForceLaw:
    """force = offset + scale * excess ** exponent, with scatter proportional to the force.

    Attributes
    ----------
    coefficients : tuple of float
        ln scale (ln N), exponent, offset (N). The offset is the force that the sheet doesn't show
        (its detection threshold); 0 where the calibration doesn't ask for one.
    covariance : tuple of tuple of float, shape (3, 3)
        Of the coefficients.
    range : tuple of float
        Smallest and largest excess conductance of the calibration.
    residual_sd : float
        Scatter of ln force about the law.
    pairs : int
        Calibration pairs.
    """

    name: ClassVar[str] = "power"
    reads: ClassVar[str] = "excess"

    coefficients: tuple[float, float, float]
    covariance: tuple[tuple[float, ...], ...]
    range: tuple[float, float]
    residual_sd: float
    pairs: int

    @classmethod
    def fit(cls, excess: ArrayLike, *, force_n: ArrayLike) -> PowerForceLaw:
        """Fit the law to settled calibration pairs, robustly, in ln force.

        Parameters
        ----------
        excess : array_like, shape (n_pairs,)
            Excess conductance G/G0 - 1 summed over pixels. Pairs without load, or without a
            response, are left out: they have no logarithm.
        force_n : array_like, shape (n_pairs,)
            Reference forces, newtons.

        Raises
        ------
        CalibrationError
            If the pairs can't carry the law: too few, one load only, falling with the load.

        Examples
        --------
        >>> law = PowerForceLaw.fit([1.0, 4.0, 9.0, 16.0, 25.0], force_n=[1.0, 2, 3, 4, 5])
        >>> law.force_n([4.0, 100.0]).value.round(3).tolist()
        [2.0, 10.0]
        >>> law.force_n([4.0, 100.0]).in_range.tolist()
        [True, False]
        """
        x, y = checked_pairs(excess, force_n)
        keep = (x > 0) & (y > 0)
        x, y = enough_pairs(x[keep], y[keep])
        log_x, log_y = np.log(x), np.log(y)
        if theilslopes(log_y, log_x)[0] <= 0:
            raise CalibrationError(
                "force calibration: the excess conductance falls while the load rises; "
                "check the wiring, the divider's leg and that the rest was taken unloaded"
            )
        plain = _fit_log(log_x, log_y, with_offset=False)
        offset = _fit_log(log_x, log_y, with_offset=True) if len(x) > MIN_PAIRS else plain
        coefficients, covariance, residual_sd = min(plain, offset, key=lambda fit: fit[3])[:3]
        return cls(
            coefficients=(float(coefficients[0]), float(coefficients[1]), float(coefficients[2])),
            covariance=tuple(map(tuple, covariance.tolist())),
            range=(float(x.min()), float(x.max())),
            residual_sd=residual_sd,
            pairs=len(x),
        )

    def force_n(self, excess: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        """Return the force of each excess conductance, of any shape; see `ForceEstimate`.

        No response (excess of 0 or less) reads as no force, with an interval that reaches up to the
        weakest force of the calibration.
        """
        x = np.asarray(excess, dtype=float)
        responds = x > 0
        log_x = np.log(np.where(responds, x, self.range[0]))
        log_scale, exponent, offset = self.coefficients
        grown = np.exp(log_scale + exponent * log_x)
        value = offset + grown
        gradient = np.stack([grown, grown * log_x, np.ones_like(grown)], axis=-1) / value[..., None]
        cov = np.array(self.covariance)
        variance = self.residual_sd**2 + np.einsum("...i,ij,...j->...", gradient, cov, gradient)
        freedom = self.pairs - (3 if offset > 0 else 2)
        spread = np.exp(student_t.ppf(0.5 + level / 2, freedom) * np.sqrt(variance))
        return ForceEstimate(
            value=np.where(responds, value, 0.0),
            low=np.where(responds, value / spread, 0.0),
            high=value * spread,
            in_range=(x >= self.range[0]) & (x <= self.range[1]),
            level=level,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file; `law_from_dict` reads them back."""
        return {
            "law": self.name,
            "coefficients": list(self.coefficients),
            "covariance": [list(row) for row in self.covariance],
            "range": list(self.range),
            "residual_sd": self.residual_sd,
            "pairs": self.pairs,
        }


def _fit_log(
    log_x: FloatArray, log_y: FloatArray, *, with_offset: bool
) -> tuple[FloatArray, FloatArray, float, float]:
    """Return coefficients, covariance, residual sd of ln force, and BIC."""
    count = 3 if with_offset else 2

    def residuals(p: FloatArray) -> FloatArray:
        offset = p[2] if with_offset else 0.0
        return np.asarray(np.log(offset + np.exp(p[0] + p[1] * log_x)) - log_y)

    slope, intercept = theilslopes(log_y, log_x)[:2]
    weakest = float(np.exp(log_y.min()))
    start = np.array([intercept, slope, 0.2 * weakest])[:count]
    upper = np.array([np.inf, np.inf, weakest])[:count]
    scale = max(2.5 * 1.48 * float(np.median(np.abs(residuals(start)))), 1e-6)
    found = least_squares(
        residuals, start, bounds=([-np.inf, 0.0, 0.0][:count], upper), loss="cauchy", f_scale=scale
    )
    left = residuals(found.x)
    jacobian = np.asarray(found.jac, dtype=float)
    squares = float(left @ left)
    freedom = len(log_x) - count
    covariance = np.zeros((3, 3))
    # pinv: an offset on its bound has no gradient to invert.
    covariance[:count, :count] = np.linalg.pinv(jacobian.T @ jacobian) * squares / freedom
    coefficients = np.zeros(3)
    coefficients[:count] = found.x
    bic = len(log_x) * np.log(max(float(found.cost), 1e-24)) + count * np.log(len(log_x))
    return coefficients, covariance, float(np.sqrt(squares / freedom)), float(bic)
