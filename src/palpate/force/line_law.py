"""The paper's linear law of force over mean relative change (Table 4)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from palpate.arrays import FloatArray
from palpate.calibration import ForcePairs
from palpate.errors import CalibrationError

#: Fewest calibration pairs for an estimate of the scatter.
MIN_PAIRS = 4
#: Smallest ratio of largest to smallest load for an estimate of the slope.
MIN_LOAD_RATIO = 1.2


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceEstimate:
    """Forces with intervals, newtons; arrays of the shape of the readings.

    Attributes
    ----------
    value, low, high : ndarray
        Force and the ends of its prediction interval, never below 0.
    in_range : ndarray of bool
        Whether the reading is within the range of the calibration. Outside it, the value is an
        extrapolation.
    level : float
        Nominal coverage of the interval.
    """

    value: FloatArray
    low: FloatArray
    high: FloatArray
    in_range: NDArray[np.bool_]
    level: float


def check_pairs(reading: ArrayLike, force_n: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return readings and forces as finite float arrays of equal length."""
    x, y = np.asarray(reading, dtype=float), np.asarray(force_n, dtype=float)
    if x.ndim != 1 or x.shape != y.shape:
        raise ValueError(f"readings and forces must have equal shapes, not {x.shape} and {y.shape}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise CalibrationError("force calibration: a reading or force is not a finite number")
    return x, y


def require_pairs(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the pairs unchanged; raise `CalibrationError` for too few, or a single load."""
    if len(x) < MIN_PAIRS:
        raise CalibrationError(
            f"force calibration: {len(x)} usable pairs, at least {MIN_PAIRS} needed; add loads"
        )
    if y.max() < MIN_LOAD_RATIO * max(y.min(), 0.0) or np.ptp(y) == 0:
        raise CalibrationError(
            f"force calibration: the load hardly changes ({y.min():g} to {y.max():g} N); "
            "use loads over the whole range"
        )
    return x, y


def law_sd(gradient: FloatArray, *, covariance: ArrayLike, residual_sd: float) -> FloatArray:
    """Return the standard deviation of a prediction, from coefficients and scatter.

    `gradient`, shape (..., coefficients): gradient with respect to the coefficients.
    `covariance`, shape (coefficients, coefficients): covariance of the coefficients.
    `residual_sd`: scatter of the calibration about the law.

    >>> law_sd(np.array([[1.0, 2.0]]), covariance=np.eye(2), residual_sd=2.0).tolist()
    [3.0]
    """
    known = np.einsum("...i,ij,...j->...", gradient, np.asarray(covariance), gradient)
    return np.asarray(np.sqrt(residual_sd**2 + known))


def law_as_dict(law: Any) -> dict[str, Any]:
    """Return a law's name and numbers as plain values for a calibration file."""
    return {"law": law.name, **{name: _as_list(value) for name, value in asdict(law).items()}}


def _as_list(value: Any) -> Any:
    return [_as_list(part) for part in value] if isinstance(value, tuple) else value


@dataclass(frozen=True, slots=True, kw_only=True)
class LineForceLaw:
    """force = slope * mean relative change + intercept (paper, Table 4).

    Attributes
    ----------
    coefficients : tuple of float
        Slope (N/%, negative: resistance falls under load) and intercept (N).
    covariance : tuple of tuple of float, shape (2, 2)
        Covariance of the coefficients.
    range : tuple of float
        Smallest and largest relative change of the calibration, percent.
    residual_sd : float
        Scatter about the line, newtons.
    pairs : int
        Calibration pairs.
    """

    name: ClassVar[str] = "line"

    coefficients: tuple[float, float]
    covariance: tuple[tuple[float, ...], ...]
    range: tuple[float, float]
    residual_sd: float
    pairs: int

    @classmethod
    def fit(cls, relative_percent: ArrayLike, *, force_n: ArrayLike) -> LineForceLaw:
        """Fit the line by least squares to settled calibration pairs.

        Parameters
        ----------
        relative_percent : array_like, shape (n_pairs,)
            Mean over pixels of the relative change (eq. 1), percent.
        force_n : array_like, shape (n_pairs,)
            Reference forces, newtons.

        Raises
        ------
        CalibrationError
            If there are too few pairs, a single load, or a single reading.

        Examples
        --------
        >>> law = LineForceLaw.fit([-10.0, -20, -30, -40, -50], force_n=[3.0, 4, 5, 6, 7])
        >>> [round(c, 6) for c in law.coefficients]
        [-0.1, 2.0]
        """
        x, y = require_pairs(*check_pairs(relative_percent, force_n))
        if np.ptp(x) == 0:
            raise CalibrationError(
                "force calibration: all readings are equal; is the sensor saturated?"
            )
        design = np.stack([x, np.ones_like(x)], axis=1)
        coefficients = np.linalg.lstsq(design, y, rcond=None)[0]
        variance = float(np.sum((y - design @ coefficients) ** 2)) / (len(x) - 2)
        return cls(
            coefficients=(float(coefficients[0]), float(coefficients[1])),
            covariance=tuple(map(tuple, (variance * np.linalg.inv(design.T @ design)).tolist())),
            range=(float(x.min()), float(x.max())),
            residual_sd=float(np.sqrt(variance)),
            pairs=len(x),
        )

    def force_n(self, relative_percent: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        """Return the force of each relative change, of any shape; see `ForceEstimate`."""
        x = np.asarray(relative_percent, dtype=float)
        slope, intercept = self.coefficients
        value = slope * x + intercept
        gradient = np.stack([x, np.ones_like(x)], axis=-1)
        sd = law_sd(gradient, covariance=self.covariance, residual_sd=self.residual_sd)
        half = stdtrit(self.pairs - 2, 0.5 + level / 2) * sd
        return ForceEstimate(
            value=np.maximum(value, 0.0),
            low=np.maximum(value - half, 0.0),
            high=np.maximum(value + half, 0.0),
            in_range=(x >= self.range[0]) & (x <= self.range[1]),
            level=level,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file."""
        return law_as_dict(self)


def fit_settled_line(pairs: ForcePairs, *, horizon_s: float) -> LineForceLaw:
    """Fit the line to the settled pairs of a calibration.

    Raises `CalibrationError` if there are too few.
    """
    settled = np.isclose(pairs.since_move_s, horizon_s)
    if not settled.any():
        raise CalibrationError(
            "the calibration has no settled pairs; run `palpate calibrate force`"
        )
    return LineForceLaw.fit(
        np.array(pairs.relative_percent)[settled], force_n=np.array(pairs.force_n)[settled]
    )
