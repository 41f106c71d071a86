"""A power law for a new sensor from few weights, with what other sensors of its kind teach.

Sensors of one kind differ most under light loads, where the contact between sheet and electrode
decides, and least in the middle of the range, where the sheet does. So the law of a new sensor is
drawn from a population with its own spread of gain, taken there, and of exponent; the new sensor's
few weights move it as far as they are worth against that spread.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import t as student_t

from palpate.errors import CalibrationError
from palpate.estimate.force_pairs import FloatArray, ForceEstimate

#: Before any sensor of the kind is seen. Gain: Velostat's conductance at one force varies by a
#: log-sd of 0.6 from place to place (robot presses), times an exponent near 0.8. Scatter: a weight
#: put down anew finds about half of that change. Exponent: a judgement, wide for powers near 1;
#: too few sensors are on record to measure it.
PRIOR_GAIN_SD = 0.5
PRIOR_EXPONENT_SD = 0.3
PRIOR_SCATTER_SD = 0.3
#: Sensors that the prior spreads are worth.
PRIOR_SENSORS = 3
#: Fewer loaded steps than this don't show a sensor's own law.
MIN_STEPS = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class PopulationForceLaw:
    """ln force = gain + exponent * (ln excess conductance - pivot), spread over sensors of a kind.

    Attributes
    ----------
    pivot : float
        ln of the excess conductance G - G0 in siemens, in the middle of the range.
    gain, exponent : float
        Mean over sensors, of ln force (N) at the pivot and of its slope.
    gain_sd, exponent_sd : float
        Spread over sensors.
    scatter_sd : float
        Of ln force about one sensor's law.
    range : tuple of float
        Smallest and largest excess conductance seen, siemens.
    sensors : int
        Sensors seen.
    """

    pivot: float
    gain: float
    exponent: float
    gain_sd: float
    exponent_sd: float
    scatter_sd: float
    range: tuple[float, float]
    sensors: int

    @classmethod
    def fit(
        cls, conductances_s: Sequence[ArrayLike], *, forces_n: Sequence[ArrayLike]
    ) -> PopulationForceLaw:
        """Learn the population from the calibrations of its sensors.

        Parameters
        ----------
        conductances_s : sequence of array_like, each of shape (n_steps,)
            Excess conductance G - G0 of each sensor's loaded steps, siemens, above 0.
        forces_n : sequence of array_like, each of shape (n_steps,)
            Loads of the same steps, newtons, above 0.

        Raises
        ------
        CalibrationError
            If there is no sensor, or one has fewer than five steps.

        Examples
        --------
        >>> loads = [[1.0, 2, 3, 4, 5], [1.0, 2, 3, 4, 5]]
        >>> readings = [[0.01, 0.02, 0.03, 0.04, 0.05], [0.02, 0.04, 0.06, 0.08, 0.1]]
        >>> law = PopulationForceLaw.fit(readings, forces_n=loads)
        >>> round(law.exponent, 6)
        1.0
        >>> law.calibrate([0.015], force_n=[1.0]).force_n([0.03]).value.round(2).tolist()
        [2.03]
        """
        if not conductances_s:
            raise CalibrationError("no sensor to learn from: give at least one ladder of weights")
        logs = [np.log(np.asarray(one, dtype=float)) for one in conductances_s]
        forces = [np.log(np.asarray(one, dtype=float)) for one in forces_n]
        shortest = min(map(len, logs))
        if shortest < MIN_STEPS:
            raise CalibrationError(
                f"a sensor has {shortest} loaded steps, at least {MIN_STEPS} needed to learn from"
            )
        pivot = float(np.mean([np.mean(x) for x in logs]))
        lines = np.array([np.polyfit(x - pivot, y, 1) for x, y in zip(logs, forces, strict=True)])
        left = [
            y - np.polyval(line, x - pivot) for line, x, y in zip(lines, logs, forces, strict=True)
        ]
        exponent, gain = (float(mean) for mean in lines.mean(axis=0))
        return cls(
            pivot=pivot,
            gain=gain,
            exponent=exponent,
            gain_sd=_spread(lines[:, 1] - gain, prior_sd=PRIOR_GAIN_SD),
            exponent_sd=_spread(lines[:, 0] - exponent, prior_sd=PRIOR_EXPONENT_SD),
            scatter_sd=_spread(
                np.array([np.sqrt(np.sum(one**2) / (len(one) - 2)) for one in left]),
                prior_sd=PRIOR_SCATTER_SD,
                lost=0,
            ),
            range=(float(np.exp(min(map(np.min, logs)))), float(np.exp(max(map(np.max, logs))))),
            sensors=len(logs),
        )

    def calibrate(self, conductance_s: ArrayLike, *, force_n: ArrayLike) -> SensorForceLaw:
        """Return the law of a new sensor of the kind, from any number of its own weights.

        Parameters
        ----------
        conductance_s, force_n : array_like, shape (n_weights,)
            Excess conductance (siemens) and load (newtons) of each weight; may be empty.
        """
        x = np.log(np.asarray(conductance_s, dtype=float)) - self.pivot
        y = np.log(np.asarray(force_n, dtype=float))
        design = np.stack([np.ones_like(x), x], axis=1)
        prior = np.diag([self.gain_sd**-2, self.exponent_sd**-2])
        mean = np.array([self.gain, self.exponent])
        covariance = np.linalg.inv(design.T @ design / self.scatter_sd**2 + prior)
        solution = covariance @ (design.T @ y / self.scatter_sd**2 + prior @ mean)
        return SensorForceLaw(
            population=self,
            gain=float(solution[0]),
            exponent=float(solution[1]),
            covariance=tuple(map(tuple, covariance.tolist())),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorForceLaw:
    """The law of one sensor; see `PopulationForceLaw.calibrate`.

    Attributes
    ----------
    population : PopulationForceLaw
        Where it was drawn from.
    gain, exponent : float
        Of this sensor.
    covariance : tuple of tuple of float, shape (2, 2)
        Of the two.
    """

    population: PopulationForceLaw
    gain: float
    exponent: float
    covariance: tuple[tuple[float, ...], ...]

    def force_n(
        self, conductance_s: ArrayLike, /, *, log_noise: ArrayLike = 0.0, level: float = 0.9
    ) -> ForceEstimate:
        """Return the force of each excess conductance.

        Parameters
        ----------
        conductance_s : array_like
            Excess conductance G - G0, siemens, above 0; any shape.
        log_noise : array_like, broadcastable to it
            Standard deviation of ln conductance by noise and by the last digit of the readout.
        level : float
            Probability that the interval is to cover.
        """
        conductance = np.asarray(conductance_s, dtype=float)
        x = np.log(conductance) - self.population.pivot
        gradient = np.stack([np.ones_like(x), x], axis=-1)
        variance = (
            np.einsum("...i,ij,...j->...", gradient, np.array(self.covariance), gradient)
            + self.population.scatter_sd**2
            + (self.exponent * np.asarray(log_noise, dtype=float)) ** 2
        )
        # The spreads themselves come from few sensors, which widens the tails.
        freedom = self.population.sensors + PRIOR_SENSORS - 1
        spread = np.exp(student_t.ppf(0.5 + level / 2, freedom) * np.sqrt(variance))
        value = np.exp(self.gain + self.exponent * x)
        low, high = self.population.range
        return ForceEstimate(
            value=value,
            low=value / spread,
            high=value * spread,
            in_range=(conductance >= low) & (conductance <= high),
            level=level,
        )


def _spread(deviations: FloatArray, *, prior_sd: float, lost: int = 1) -> float:
    """Return the sd of few deviations, shrunk to a prior worth `PRIOR_SENSORS` of them."""
    squares = PRIOR_SENSORS * prior_sd**2 + float(np.sum(deviations**2))
    return float(np.sqrt(squares / (PRIOR_SENSORS + len(deviations) - lost)))
