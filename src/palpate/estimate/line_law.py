"""The paper's linear law of force over mean relative change (Table 4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from palpate.errors import CalibrationError
from palpate.estimate.force import (
    ForceEstimate,
    check_pairs,
    law_as_dict,
    law_sd,
    require_pairs,
)
from palpate.sensor.calibration import ForcePairs


@dataclass(frozen=True, slots=True, kw_only=True)
class LineForceLaw:
    """force = slope * mean relative change + intercept (paper, Table 4).

    Attributes
    ----------
    coefficients : tuple of float
        Slope (N/%, negative: resistance falls under load) and intercept (N).
    covariance, range, residual_sd, pairs
        As in `PowerForceLaw`; the range in percent, the scatter in newtons.
    """

    name: ClassVar[str] = "line"
    reads: ClassVar[str] = "relative_percent"

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
