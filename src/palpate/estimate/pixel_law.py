"""Force as a sum over pixels, each computed from the pixel's excess conductance.

Forces of pixels add up to the total force. Conductances do not, because a pixel's law is nonlinear
and has a threshold. The same force on four pixels or on two therefore has different sums of
conductances, but equal sums of pixel forces.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from palpate.arrays import FloatArray, replace_non_finite
from palpate.estimate.force import ForceEstimate, require_pairs
from palpate.measurement import find_spread, half_width_sds

#: Powers of the excess in the law of a pixel. With positive weights every mixture rises; the
#: smallest power represents the threshold.
EXPONENTS = (0.1, 0.3, 0.5, 0.75, 1.0, 1.4)
#: Prior standard deviation of a pixel's ln gain relative to its sheet.
GAIN_SD = 0.05
#: Assumed relative error of a pair, and the force below which errors are constant in newtons.
_RELATIVE_ERROR, _WEAK_N = 0.06, 0.3
#: Fewest placements for a cross-validated error.
_FEWEST_RUNS = 3
#: Prior standard deviation of the exponent about 1; lag hardly changes it.
_EXPONENT_SD = 0.15
#: Smallest exponent; with weights on real Velostat it was never below 0.6.
_LEAST_EXPONENT = 0.5
#: Force above which errors are relative, and below which they are in newtons.
_FIRM_N = 1.0
_ROUNDS = 3
#: SciPy's default, three per weight, is too small for some sheets of level `field`.
_MOST_ITERATIONS = 1000
#: Largest excess of a pixel that is noise of its rest value.
_NOISE_EXCESS = 0.004


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelReading:
    """Converts the excess of all pixels to one reading that rises with the grip force.

    Without a calibration of the pixels, the reading is the summed excess:

    >>> PixelReading.sum_pixels().reading([[1.0, 0.0], [float("nan"), 2.5]]).item()
    3.5
    """

    #: A pixel contributes sum_k weights[k] * excess ** exponents[k].
    exponents: tuple[float, ...]
    weights: tuple[float, ...]
    #: Gain of each pixel; empty for equal gains.
    gains: tuple[float, ...] = ()

    @classmethod
    def sum_pixels(cls) -> PixelReading:
        """Return the plain sum of excess conductances."""
        return cls(exponents=(1.0,), weights=(1.0,))

    @classmethod
    def fit(cls, pixel_excess: ArrayLike, *, force_n: ArrayLike) -> PixelReading:
        """Fit weights and gains to readings taken with a load cell.

        `pixel_excess`, shape (n, pixels): excess conductance of each pixel.
        `force_n`, shape (n,): reference forces, newtons.
        Raises `CalibrationError` if there are too few pairs.

        A sheet with an excess proportional to the square of the load, pressed fully and in part:

        >>> whole = np.outer(np.arange(1, 6) ** 2 / 4.0, [1, 1, 1, 1])
        >>> part = np.outer(np.arange(1, 6) ** 2, [1, 0, 0, 1])
        >>> force_n = 2 * np.arange(1, 6)
        >>> found = PixelReading.fit([*whole, *part], force_n=[*force_n, *force_n])
        >>> round(float(found.reading([[9.0, 9.0, 0.0, 0.0]])), 1)
        6.0
        """
        excess = np.asarray(pixel_excess, dtype=float)
        # Raises an error for too few pairs, or a single load.
        require_pairs(excess.sum(axis=1), np.asarray(force_n, dtype=float))
        force = np.asarray(force_n, dtype=float)
        basis = _basis(excess, EXPONENTS)
        weight = 1.0 / (force + _WEAK_N)
        gains = np.ones(excess.shape[1])
        for _ in range(_ROUNDS):
            design = np.einsum("npk,p->nk", basis, gains)
            scaled = design * weight[:, None]
            weights = nnls(scaled, force * weight, maxiter=_MOST_ITERATIONS)[0]
            fractions = (basis @ weights) * weight[:, None] / _RELATIVE_ERROR
            residual = force * weight / _RELATIVE_ERROR - fractions.sum(axis=1)
            prior = np.eye(gains.size) / GAIN_SD**2
            gains = 1.0 + np.linalg.solve(fractions.T @ fractions + prior, fractions.T @ residual)
        return cls(
            exponents=EXPONENTS,
            weights=tuple(weights.tolist()),
            gains=tuple(np.maximum(gains, 0.5).tolist()),
        )

    def reading(self, excess: ArrayLike) -> FloatArray:
        """Return the reading of frames, shape (..., rows, cols) to (...); NaN counts as 0."""
        grid = np.asarray(excess, dtype=float)
        flat = grid.reshape(*grid.shape[:-2], -1)
        if not self.gains:
            return np.asarray(np.nansum(flat, axis=-1))
        fractions = _basis(flat, self.exponents) @ np.array(self.weights)
        return np.asarray(fractions @ np.array(self.gains))


@dataclass(frozen=True, slots=True, kw_only=True)
class PixelForceLaw:
    """force = scale * reading ** exponent, with proportional scatter and a floor in newtons."""

    name: ClassVar[str] = "pixels"
    reads: ClassVar[str] = "pixels"

    #: Coefficients.
    log_scale: float
    exponent: float
    #: Cross-validated standard deviations of ln force, and of weak forces in newtons.
    residual_sd: float
    floor_n: float
    #: Smallest and largest reading of the calibration.
    range: tuple[float, float]

    @classmethod
    def fit(cls, reading: ArrayLike, *, force_n: ArrayLike, run: ArrayLike) -> PixelForceLaw:
        """Fit one exponent, with a prior near 1, within placements; the scale is their mean.

        Placements differ by a factor. A common fit would make the exponent too small, and large
        forces too small, because errors in the reading attenuate a regression. `fit_laws` adds the
        uncertainty.

        `reading`, `force_n`, shape (n,): readings, and the forces measured with them, newtons.
        `run`, shape (n,): placement of each reading.
        Raises `CalibrationError` if there are too few pairs.

        Two placements, of which the second reads a third more:

        >>> reading = np.array([1.0, 2.0, 4.0, 8.0])
        >>> law = PixelForceLaw.fit([*reading, *(1.33 * reading)], force_n=[*reading, *reading],
        ...     run=[0] * 4 + [1] * 4)
        >>> round(law.exponent, 3), law.force_n([1.0, 1.33]).value.round(2).tolist()
        (1.0, [0.87, 1.15])
        """
        x, y = np.asarray(reading, dtype=float), np.asarray(force_n, dtype=float)
        keep = (x > 0.3 * _WEAK_N) & (y > _WEAK_N)
        x, y = require_pairs(x[keep], y[keep])
        of_run = np.unique(np.asarray(run)[keep], return_inverse=True)[1]
        # Readings near the threshold have a small weight, because they would tilt the line.
        log_x, log_ratio, weight = np.log(x), np.log(y / x), y**2 / (y**2 + _FIRM_N**2)
        weight_of = np.bincount(of_run, weights=weight)
        middle = np.bincount(of_run, weights=weight * log_x) / weight_of
        offset = np.bincount(of_run, weights=weight * log_ratio) / weight_of
        away = log_x - middle[of_run]
        precision = (_RELATIVE_ERROR / _EXPONENT_SD) ** 2 + (weight * away**2).sum()
        slope = float((weight * away * (log_ratio - offset[of_run])).sum() / precision)
        # Lag can tilt the line so far that the force falls with the reading.
        slope = max(slope, _LEAST_EXPONENT - 1.0)
        return cls(
            log_scale=float(np.average(offset - slope * middle, weights=weight_of)),
            exponent=1.0 + slope,
            residual_sd=_RELATIVE_ERROR,
            floor_n=0.1 * _WEAK_N,
            range=(float(x.min()), float(x.max())),
        )

    def force_n(self, reading: ArrayLike, /, *, level: float = 0.9) -> ForceEstimate:
        """Return the force of each reading, of any shape."""
        x = np.maximum(np.asarray(reading, dtype=float), 0.0)
        value = np.exp(self.log_scale) * x**self.exponent
        half = half_width_sds(level)
        # The scatter of weak forces is constant, that of firm forces proportional.
        floor_n = half * self.floor_n
        up = np.hypot(value * np.expm1(half * self.residual_sd), floor_n)
        down = np.hypot(value * -np.expm1(-half * self.residual_sd), floor_n)
        return ForceEstimate(
            value=value,
            low=np.maximum(value - down, 0.0),
            high=value + up,
            in_range=(x >= self.range[0]) & (x <= self.range[1]),
            level=level,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values."""
        return {
            "law": self.name,
            "log_scale": self.log_scale,
            "exponent": self.exponent,
            "residual_sd": self.residual_sd,
            "floor_n": self.floor_n,
            "range": list(self.range),
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementReadings:
    """Sheet readings with load-cell forces, soon after a movement (`early`) or settled."""

    run: FloatArray
    pixel_excess: FloatArray
    force_n: FloatArray
    early: NDArray[np.bool_]

    def exclude_run(self, run: float) -> PlacementReadings:
        """Return the readings of all other placements."""
        return self._select(self.run != run)

    def select_run(self, run: float) -> PlacementReadings:
        """Return the readings of one placement."""
        return self._select(self.run == run)

    def _select(self, chosen: NDArray[np.bool_]) -> PlacementReadings:
        return PlacementReadings(
            run=self.run[chosen],
            pixel_excess=self.pixel_excess[chosen],
            force_n=self.force_n[chosen],
            early=self.early[chosen],
        )


def fit_laws(placements: PlacementReadings) -> tuple[PixelReading, PixelForceLaw, PixelForceLaw]:
    """Fit the conversion of pixels to a reading, and its early and settled force laws.

    The uncertainty is measured by cross-validation over placements.

    Raises `CalibrationError` if there are too few pairs.
    """
    reading, early, settled = _fit(placements)
    if np.unique(placements.run).size < _FEWEST_RUNS:
        return reading, early, settled
    estimated, force, is_early = predict_held_out(placements)
    return (
        reading,
        _with_uncertainty(early, estimated[is_early], force[is_early]),
        _with_uncertainty(settled, estimated[~is_early], force[~is_early]),
    )


def predict_held_out(
    placements: PlacementReadings,
) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
    """Predict the forces of each placement with laws fitted to the others.

    Returns, each of shape (n,): predicted force, reference force, and whether the reading is early.
    Raises `CalibrationError` if there are too few pairs.
    """
    estimated, force, early = [], [], []
    for run in np.unique(placements.run):
        other, *laws = _fit(placements.exclude_run(run))
        test = placements.select_run(run)
        seen = other.reading(test.pixel_excess[:, None, :])
        estimated.append(np.where(test.early, *(law.force_n(seen).value for law in laws)))
        force.append(test.force_n)
        early.append(test.early)
    return np.concatenate(estimated), np.concatenate(force), np.concatenate(early)


def _fit(placements: PlacementReadings) -> tuple[PixelReading, PixelForceLaw, PixelForceLaw]:
    early, force, run = placements.early, placements.force_n, placements.run
    reading = PixelReading.fit(placements.pixel_excess[early], force_n=force[early])
    seen = reading.reading(placements.pixel_excess[:, None, :])
    return (
        reading,
        PixelForceLaw.fit(seen[early], force_n=force[early], run=run[early]),
        PixelForceLaw.fit(seen[~early], force_n=force[~early], run=run[~early]),
    )


#: Largest uncertainty of a calibration (ln force).
_MAX_LOG_SD = 0.7
#: Fewest errors for the use of their quantile.
_MANY = 20


def _with_uncertainty(
    law: PixelForceLaw, estimated: FloatArray, force: FloatArray
) -> PixelForceLaw:
    """Return the law with the measured uncertainty of ln force and of weak forces.

    Faint and firm are distinguished by the estimated force, as in a grasp.
    """
    firm = estimated > _FIRM_N
    log_error = np.log(estimated[firm] / np.maximum(force[firm], 0.1))
    error_n = estimated[~firm] - force[~firm]
    return replace(
        law,
        residual_sd=min(max(_spread(log_error), 0.03), _MAX_LOG_SD),
        floor_n=max(_spread(error_n), 0.02),
    )


def _spread(errors: FloatArray) -> float:
    """Return the standard deviation of errors, from their 90 % quantile.

    With few errors it is their RMS, because the quantile would be the largest error.
    """
    if errors.size < _MANY:
        return float(np.sqrt(np.mean(errors**2))) if errors.size else 0.0
    return find_spread(errors)


def _basis(excess: FloatArray, exponents: tuple[float, ...]) -> FloatArray:
    above = np.maximum(replace_non_finite(excess) - _NOISE_EXCESS, 0.0)
    return np.asarray(above[..., None] ** np.array(exponents))
