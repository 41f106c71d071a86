"""Force law with memory: a linear regression of ln force on the reading's history.

ln force = w . [1, x, x - x1, ..., x - x6, fall, curve]. x is the logarithm of the excess
conductance, x1 to x6 are its low-passed copies, and `fall` is the fall from its recent maximum. The
weights w of a contact are Gaussian. Their prior is the distribution over other sensors (the
population), and every measured force is one Kalman update. The interval includes the remaining
covariance of the weights and the scatter about the law.

The unit of the readings is that of the sensor. Settled readings given to `ForceLaw.fit` are scaled
so that their median is the population's middle reading, so that a sensor without a conductance at
rest, whose reading has no natural unit, has the same force in any unit.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from importlib.resources import files
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, InputError
from palpate.force.creep_update import EARLY_S, update_creep
from palpate.force.force_states import (
    CONTACT_EXCESS,
    TIME_CONSTANTS_S,
    compute_states,
    log_reading,
)
from palpate.measurement import Measurement, half_width_sds

#: Number of inputs of a sample: the reading, its difference from each copy, and the fall.
INPUTS = 2 + len(TIME_CONSTANTS_S)
#: Standardised inputs are clipped to this, the range of the training set.
_FARTHEST = 4.0
#: Largest factor by which the interval of ln force grows below the training set's weakest force
#: (guess).
_MAX_WIDENING = 4.0
#: Largest weight of the samples of one contact, in independent samples, because they are correlated
#: (error of strokes at a known place: equal for 15 to 30, larger for 5 and 60).
MOST_SAMPLES = 25.0
#: On a steep rise, a force determines the gain of a contact, but hardly its memory, because a
#: timing error resembles memory. There, weights other than the constant get this fraction of an
#: update (fraction 1: strokes .110/.225 and presses .045; fraction 0.3: .103/.201 and .028).
MEMORY_FRACTION = 0.3
#: Smallest given reading over the reading of a contact, for a weight up to the usual first weight,
#: newtons; proportionally more for a heavier one. On a sheet like those of the population, 1.5 N is
#: an excess of 4, and contact begins at 0.1.
_LEAST_OVER_CONTACT, _FIRST_N = 40.0, 1.5
#: Number of readings up to the smallest given one whose smallest upper limit applies to a reading.
_LARGER = 9
#: Smallest and largest exponent of force over excess near the threshold. On ladders of real
#: Velostat it is 0.6 to 1.3, and on a conductive rubber 1.4.
_FLATTEST, _STEEPEST = 0.5, 2.0
#: Margin of a limit that is to include a number.
_ROUNDING = 1.0 + 1e-9
#: Fewest given weights whose falling line is a wrong reading, and not scatter: of 580 times three
#: or six weights on simulated sheets (`field`), 2 have one.
_FEWEST_REVERSED = 3
#: Difference of ln excess from its 0.1 s copy that counts as a rise, and that copy's input index.
_RISING, _COPY = 0.05, 3
#: Weights of the differences from the copies.
_CREEP = slice(2, 2 + len(TIME_CONSTANTS_S))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Population:
    """Prior of the law over sensors of one kind, learned by `palpate study force-population`.

    Attributes
    ----------
    centre, scale : ndarray, shape (INPUTS + 1,)
        Mean and standard deviation of the inputs and of the curve.
    mean : ndarray, shape (INPUTS + 3,)
        Mean weights of the constant, the standardised inputs, the curve, and the flag for a force
        measured earlier in the contact.
    spread : ndarray, shape (INPUTS + 3, INPUTS + 3)
        Covariance of the weights over sensors and places.
    contact_spread : ndarray, shape (INPUTS + 3, INPUTS + 3)
        Covariance of their change between contacts at one place.
    noise : ndarray, shape (4,)
        Coefficients of ln scatter of ln force: constant, reading, speed and fall.
    least_n : float
        Weakest force of the training set, newtons; below it the scatter is constant in newtons.
    """

    centre: FloatArray
    scale: FloatArray
    mean: FloatArray
    spread: FloatArray
    contact_spread: FloatArray
    noise: FloatArray
    least_n: float

    def as_dict(self) -> dict[str, Any]:
        """Return plain values; the inverse of `population_from_dict`."""
        return {
            one.name: np.asarray(getattr(self, one.name)).tolist() for one in fields(Population)
        }

    def design(self, inputs: ArrayLike, *, has_force: bool) -> FloatArray:
        """Return the regressors of samples, shape (n, INPUTS) to (n, INPUTS + 3).

        `has_force`: whether a force was measured earlier in the same contact.
        """
        z = standardise(np.asarray(inputs, dtype=float), centre=self.centre, scale=self.scale)
        return np.column_stack([np.ones(len(z)), z, np.full(len(z), float(has_force))])

    def variance(self, design: FloatArray) -> FloatArray:
        """Return the variance of ln force about the law for each sample, shape (n,)."""
        return np.asarray(np.exp(2.0 * np.clip(noise_inputs(design) @ self.noise, -4.0, 0.5)))


def standardise(inputs: FloatArray, *, centre: FloatArray, scale: FloatArray) -> FloatArray:
    """Return standardised and clipped inputs with the curve, shape (n, INPUTS + 1)."""
    z = (with_curve(inputs) - centre) / scale
    return np.asarray(np.clip(z, -_FARTHEST, _FARTHEST))


def with_curve(inputs: FloatArray) -> FloatArray:
    """Append the squared reading to the inputs, for the bend of a saturating sheet."""
    return np.column_stack([inputs, np.maximum(inputs[:, 0], 0.0) ** 2])


def noise_inputs(design: FloatArray) -> FloatArray:
    """Return the regressors of the scatter, shape (n, 4): 1, reading, speed, fall."""
    speed = np.abs(design[:, 4])
    return np.column_stack([design[:, 0], design[:, 1], speed, design[:, INPUTS]])


def scale_memory(spread: FloatArray, fraction: float) -> FloatArray:
    """Scale the standard deviation of all weights but the constant."""
    factor = np.full(len(spread), fraction)
    factor[0] = 1.0
    return spread * np.outer(factor, factor)


class ForceLaw:
    """Force with an interval from a sheet's reading, at any time of a contact.

    A reading is either the inputs of one sample, from `ForceStates`, or a settled excess
    conductance G/G0 - 1 summed over pixels.

    Attributes
    ----------
    population : Population
        Prior of the law.
    mean, covariance : ndarray, shape (INPUTS + 3,) and (INPUTS + 3, INPUTS + 3)
        Distribution of the weights in the present contact.
    known : int
        Number of measured forces so far.
    least_n : float
        Weakest measured force, newtons; the interval of a smaller force includes 0.
    scale : float
        Factor from the sensor's readings to those of the population.
    least_reading, contact_reading : float
        Smallest settled reading of `fit`, or the median of readings with history, and the reading
        above which there is contact.
    misfit : float
        Factor of the scatter, at least 1, with which the interval at each settled reading of `fit`
        includes the force given there.

    Examples
    --------
    Three dead weights on a new sheet narrow the interval:

    >>> law = ForceLaw()
    >>> before = law.force(40.0)
    >>> law = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    >>> after = law.force(40.0)
    >>> after.low < 9.0 < after.high, after.high / after.low < 0.5 * before.high / before.low
    (True, True)

    A sensor without a conductance at rest, such as an FSR: its conductance, in any unit:

    >>> siemens = ForceLaw.fit([2e-5, 6e-5, 12e-5], force_n=[1.5, 4.0, 9.0]).force(9e-5)
    >>> micro = ForceLaw.fit([20.0, 60.0, 120.0], force_n=[1.5, 4.0, 9.0]).force(90.0)
    >>> round(siemens.value, 6) == round(micro.value, 6)
    True
    """

    name: ClassVar[str] = "linear-memory"

    def __init__(self, population: Population | None = None) -> None:
        self.population = load_population() if population is None else population
        self.mean, self.covariance = self.population.mean, self.population.spread
        self.known, self.least_n, self._has_force = 0, self.population.least_n, False
        self.scale = self.misfit = 1.0
        #: Detection thresholds at the levels in use, until the law changes.
        self._thresholds_n: dict[float, float] = {}
        self.contact_reading = CONTACT_EXCESS
        self.least_reading = _LEAST_OVER_CONTACT * CONTACT_EXCESS

    @classmethod
    def fit(
        cls,
        readings: Sequence[Any] | FloatArray,
        *,
        force_n: ArrayLike,
        contact: Sequence[object] | None = None,
        population: Population | None = None,
        scale: float = 1.0,
    ) -> Self:
        """Fit the law of a sheet to measured forces, ready for a new contact.

        Parameters
        ----------
        readings : sequence of readings, length n
            Readings as described in the class. Settled readings of a sensor without a conductance
            at rest, such as an FSR, are its conductance, in any unit.
        force_n : array_like, shape (n,)
            Measured forces, newtons, above 0.
        contact : sequence, length n, optional
            Label of the contact of each sample. Later contacts have more weight. By default each
            sample is a separate contact, such as a single dead weight, and all have equal weight.
        population : Population, optional
            Prior; by default the one included in palpate.
        scale : float, optional
            Factor from readings with history, made by `trace` of a law with this factor, to those
            of the population. Settled readings are always scaled by their median.

        Raises
        ------
        CalibrationError
            If a force is not above 0, a reading or force is not finite, lengths differ, or settled
            readings are not above 0 or fall while the force rises.
        """
        law = cls(population)
        inputs, log_n = _samples(readings, force_n)
        settled = all(np.ndim(reading) == 0 for reading in readings)
        if settled:
            law._scale_to(np.asarray(readings, dtype=float), log_n)
        else:
            law.scale, law.contact_reading = scale, CONTACT_EXCESS / scale
            law.least_reading = max(float(np.median(_excess_of(inputs))), law.contact_reading)
        names = np.arange(len(log_n)) if contact is None else np.asarray(contact)
        if len(names) != len(log_n):
            raise CalibrationError(f"{len(names)} contacts for {len(log_n)} measured forces")
        for name in dict.fromkeys(names.tolist()):
            mine = names == name
            law._update_weights(inputs[mine], log_n[mine], other_contact=contact is None)
            if contact is not None:
                law.begin_contact()
        if contact is None:
            law.begin_contact()
        if settled:
            mean, sd = law.log_force(inputs)
            farthest = float(np.max(np.abs(log_n - mean) / sd))
            law.misfit = max(1.0, _ROUNDING * farthest / half_width_sds(0.9))
            law._thresholds_n = {}
        return law

    def learn_creep(self, early: ArrayLike, *, settled: ArrayLike) -> Self:
        """Learn the creep from two readings of each of n weights, and return the law.

        `early`, `settled`, shape (n,): excess conductance `creep_update.EARLY_S` after the weight
        was placed, and settled.

        >>> law = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
        >>> reading = law.trace([0.0, 2.0], [0.0, 10.0])[-1]
        >>> before = law.force(reading).value
        >>> crept = law.learn_creep([2.8, 10.0, 28.0], settled=[4.0, 15.0, 40.0])
        >>> abs(crept.force(reading).value - 4.0) < abs(before - 4.0)
        True
        """
        pairs = zip(np.asarray(early, dtype=float), np.asarray(settled, dtype=float), strict=True)
        traces = [self.trace([0.0, EARLY_S], [0.0, one])[-1] for one, _ in pairs]
        first, last = self._design(np.array(traces)), self._design(build_settled_inputs(settled))
        self.mean, self.covariance = update_creep(
            self.mean,
            self.covariance,
            creep=_CREEP,
            early=first,
            settled=last,
            error=(last - first) @ self.mean,
        )
        self._thresholds_n = {}
        return self

    def copy(self) -> Self:
        """Return an independent copy of the law."""
        other = type(self)(self.population)
        other.mean, other.covariance = self.mean, self.covariance
        other.known, other.least_n, other._has_force = self.known, self.least_n, self._has_force
        other.scale, other.misfit = self.scale, self.misfit
        other.least_reading, other.contact_reading = self.least_reading, self.contact_reading
        return other

    def begin_contact(self) -> None:
        """Widen the law for a new contact, possibly at another place of the object."""
        self.covariance = self.covariance + self.population.contact_spread
        self._has_force = False
        self._thresholds_n = {}

    def update(self, reading: Any, *, force_n: ArrayLike, sd_n: float = 0.0) -> Self:
        """Update the law with a force measured in the present contact, and return the law.

        `reading`: one reading, or a sequence of readings with equally many forces.
        `force_n`: force of a dead weight, load cell or servo current, newtons, above 0.
        `sd_n`: standard deviation of that force.
        Raises `CalibrationError` like `fit`.
        """
        many = np.ndim(force_n) > 0
        inputs, log_n = _samples(reading if many else [reading], np.atleast_1d(force_n))
        rising = bool((np.abs(inputs[:, _COPY]) > _RISING).any())
        self._update_weights(
            inputs, log_n, sd=sd_n * np.exp(-log_n), memory=MEMORY_FRACTION if rising else 1.0
        )
        self._has_force = True
        return self

    def log_force(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return the mean and standard deviation of ln(force in N) for each sample.

        `inputs`: shape (n, INPUTS).
        """
        design = self._design(np.asarray(inputs, dtype=float))
        mean = design @ self.mean
        spread = np.einsum("ni,ij,nj->n", design, self.covariance, design)
        widening = np.clip(self.population.least_n / np.exp(mean), 1.0, _MAX_WIDENING)
        sd = self.misfit * np.sqrt(spread + self.population.variance(design))
        return mean, widening * sd

    def force(
        self, reading: Any, *, level: float = 0.9, touched: bool | None = None
    ) -> Measurement:
        """Return the force at a reading; without contact, 0 with an upper limit.

        The upper limit without contact is the detection threshold: the force that would have moved
        the reading. It rises steadily to that of a force with contact.

        `touched`: whether there is contact; by default this follows from the reading.
        """
        inputs = _inputs(reading)
        excess = float(_excess_of(inputs)[0])
        quantile = half_width_sds(level)
        over = max(excess / self.contact_reading, 1.0)
        high = self.threshold_n(level=level) * over**_STEEPEST
        if over > 1.0:
            upper = self._upper_n(inputs, quantile=quantile)
            # The given forces decide from the smallest of their readings on, up to rounding.
            high = upper if excess > (1.0 - 1e-9) * self.least_reading else min(high, upper)
        if touched is None:
            touched = over > 1.0
        if not touched:
            return Measurement(value=0.0, low=0.0, high=high, unit="n", level=level)
        (mean,), (sd,) = self.log_force(inputs)
        value = float(np.exp(mean))
        return Measurement(
            value=value,
            low=float(np.exp(mean - quantile * sd)) if value >= self.least_n else 0.0,
            high=max(high, value),
            unit="n",
            level=level,
        )

    def trace(self, time_s: ArrayLike, excess: ArrayLike) -> FloatArray:
        """Return the readings with history of a recording from before the contact on.

        `time_s`, `excess`: shape (n,); the excess is summed over pixels.
        Returns inputs of `fit` and `force`, shape (n, INPUTS). Raises `ValueError` if time runs
        backwards.

        >>> ForceLaw().trace([0.0, 1.0], [0.0, 9.9]).round(1)[:, 0].tolist()
        [-2.3, 2.3]
        """
        summed = np.asarray(excess, dtype=float)
        inputs = compute_states(time_s, log_reading(self.scale * summed))
        inputs[:, 0] = log_reading(summed)
        return inputs

    def threshold_n(self, *, level: float = 0.9) -> float:
        """Return the detection threshold: a force this large would have moved the reading.

        The upper limit at the smallest given reading falls, towards the reading of a contact, at
        least with the square root of the reading. Nearly all contacts of the population's sheets
        moved the reading at its weakest force, which is the threshold without measured forces.

        >>> law = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
        >>> 0 < law.threshold_n() < 1.5
        True
        """
        weakest_n = self.population.least_n
        if self.known == 0:
            return weakest_n
        if level in self._thresholds_n:
            return self._thresholds_n[level]
        quantile = half_width_sds(level)
        least_n, contact_n = (
            self._upper_n(build_settled_inputs(reading), quantile=quantile)
            for reading in (self.least_reading, self.contact_reading)
        )
        fallen = (self.contact_reading / self.least_reading) ** _FLATTEST
        threshold_n: float = min(contact_n, max(least_n * fallen, weakest_n))
        self._thresholds_n[level] = threshold_n
        return threshold_n

    def _upper_n(self, inputs: FloatArray, *, quantile: float) -> float:
        """Return the smallest upper limit from a reading to the smallest given one.

        On one sheet a smaller reading is not a larger force, although the law, extrapolated to weak
        forces, has a larger uncertainty there.
        """
        excess = max(float(_excess_of(inputs)[0]), self.contact_reading)
        if excess >= self.least_reading:
            larger = inputs
        else:
            larger = np.repeat(inputs, _LARGER, axis=0)
            larger[:, 0] = log_reading(np.geomspace(excess, self.least_reading, _LARGER))
        mean, sd = self.log_force(larger)
        return float(np.exp(np.min(mean + quantile * sd)))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file; the inverse of `from_dict`."""
        return {
            "law": self.name,
            "known": self.known,
            "least_n": self.least_n,
            "scale": self.scale,
            "least_reading": self.least_reading,
            "contact_reading": self.contact_reading,
            "misfit": self.misfit,
            "weights": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "population": self.population.as_dict(),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Self:
        """Return the law from the output of `as_dict`.

        Raises `CalibrationError` for another kind of law, or a missing or invalid value.

        >>> law = ForceLaw.fit([4.0, 15.0], force_n=[1.5, 4.0])
        >>> ForceLaw.from_dict(law.as_dict()).force(9.0) == law.force(9.0)
        True
        """
        if stored.get("law") != cls.name:
            raise CalibrationError(
                f"force law {stored.get('law')!r} is unknown; calibrate the force again"
            )
        try:
            law = cls(population_from_dict(stored["population"]))
            law.mean = _shape(stored["weights"], law.mean.shape)
            law.covariance = _shape(stored["covariance"], law.covariance.shape)
            law.known, law.least_n = int(stored["known"]), float(stored["least_n"])
            # Laws of earlier versions have none of these.
            for name in ("scale", "least_reading", "contact_reading", "misfit"):
                setattr(law, name, _positive(stored.get(name, getattr(law, name))))
        except (KeyError, TypeError, ValueError) as error:
            raise CalibrationError(f"force law: {error}; calibrate the force again") from error
        return law

    def _scale_to(self, readings: FloatArray, log_n: FloatArray) -> None:
        """Scale the median of settled readings to the middle reading of the population.

        Raises `CalibrationError` if the readings can't be conductances that rise with the force.
        """
        if readings.min() <= 0:
            at_n = float(np.exp(log_n[readings.argmin()]))
            raise CalibrationError(
                f"force calibration: the reading at {at_n:.3g} N is {readings.min():.3g}, not "
                "above that at rest; check that the weight was on the sensor"
            )
        remedy = "give conductances, such as 1 / resistance, that rise with the force"
        refuse_reversed(readings, force_n=np.exp(log_n), remedy=remedy)
        self.scale = float(np.exp(self.population.centre[0] - np.median(np.log(readings))))
        least_n = float(np.exp(log_n[readings.argmin()]))
        self.least_reading = float(readings.min())
        self.contact_reading = self.least_reading / _LEAST_OVER_CONTACT
        self.contact_reading *= min(1.0, _FIRST_N / least_n)

    def _design(self, inputs: FloatArray) -> FloatArray:
        """Return the regressors of samples whose readings are in the sensor's unit."""
        if self.scale != 1.0:
            inputs = inputs.copy()
            inputs[:, 0] = log_reading(self.scale * _excess_of(inputs))
        return self.population.design(inputs, has_force=self._has_force)

    def _update_weights(
        self,
        inputs: FloatArray,
        log_n: FloatArray,
        *,
        sd: ArrayLike = 0.0,
        memory: float = 1.0,
        other_contact: bool = False,
    ) -> None:
        """Update the weights with samples of one contact (Kalman).

        `memory`: fraction of the update for weights other than the constant.
        `other_contact`: whether to add the scatter between contacts to the noise.
        """
        design = self._design(inputs)
        repeats = max(len(log_n) / MOST_SAMPLES, 1.0)
        noise = repeats * (self.population.variance(design) + np.asarray(sd) ** 2)
        gain = scale_memory(self.covariance, memory) @ design.T
        scatter = np.diag(noise)
        if other_contact:
            # The deviation of this contact is common to its samples, and not part of the place.
            scatter += design @ self.population.contact_spread @ design.T
        weight = np.linalg.solve(design @ gain + scatter, gain.T).T
        self.mean = self.mean + weight @ (log_n - design @ self.mean)
        # Joseph form, valid for any gain.
        reduction = np.eye(len(self.mean)) - weight @ design
        self.covariance = reduction @ self.covariance @ reduction.T + weight @ scatter @ weight.T
        self._thresholds_n = {}
        self.known += len(log_n)
        self.least_n = min(self.least_n, float(np.exp(log_n.min())))


def refuse_reversed(readings: ArrayLike, *, force_n: ArrayLike, remedy: str) -> None:
    """Raise `CalibrationError` if readings fall on the whole while their forces rise."""
    log_x, log_n = (np.log(np.asarray(each, dtype=float)) for each in (readings, force_n))
    product = (log_n - log_n.mean()) @ (log_x - log_x.mean())
    # Equal readings are all scatter.
    if log_x.size >= _FEWEST_REVERSED and product < -1e-9:
        raise CalibrationError(
            f"force calibration: the readings fall while the force rises; {remedy}"
        )


@cache
def load_population() -> Population:
    """Return the population shipped with palpate, generated by `palpate study force-population`."""
    stored = files("palpate.force").joinpath("force_population.json").read_text("utf-8")
    return population_from_dict(json.loads(stored))


def population_from_dict(stored: Mapping[str, Any]) -> Population:
    """Return a population from plain values; raises `KeyError` or `ValueError` if invalid."""
    curved, all_weights = (INPUTS + 1,), (INPUTS + 3,)
    shapes = {"centre": curved, "scale": curved, "mean": all_weights, "noise": (4,)}
    square = (INPUTS + 3, INPUTS + 3)
    names = [one.name for one in fields(Population) if one.name != "least_n"]
    arrays = {name: _shape(stored[name], shapes.get(name, square)) for name in names}
    return Population(**arrays, least_n=float(stored["least_n"]))


def _shape(values: Any, shape: tuple[int, ...]) -> FloatArray:
    array = np.asarray(values, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        got = "a value that is not finite" if array.shape == shape else f"shape {array.shape}"
        raise ValueError(f"expected an array of shape {shape} without NaN or infinity, got {got}")
    return array


def build_settled_inputs(excess: ArrayLike) -> FloatArray:
    """Convert settled excess conductances to inputs, shape (n,) to (n, INPUTS).

    >>> build_settled_inputs([0.9])[:, :2].tolist()
    [[0.0, 0.0]]
    """
    readings = np.atleast_1d(log_reading(excess))
    inputs = np.zeros((len(readings), INPUTS))
    inputs[:, 0] = readings
    return inputs


def _excess_of(inputs: FloatArray) -> FloatArray:
    """Return the excess conductances of samples, shape (n, INPUTS) to (n,)."""
    return np.asarray(np.exp(inputs[:, 0]) - CONTACT_EXCESS)


def _positive(value: Any) -> float:
    number = float(value)
    if not (np.isfinite(number) and number > 0):
        raise ValueError(f"a factor of the law is {number:g}, not above 0")
    return number


def _inputs(reading: Any) -> FloatArray:
    """Convert one reading to inputs, shape (1, INPUTS)."""
    given = np.asarray(reading, dtype=float)
    if given.ndim == 0 and not np.isnan(given):
        return build_settled_inputs(given)
    if given.shape != (INPUTS,) or np.isnan(given).any():
        got = "NaN" if np.isnan(given).any() else f"an array of shape {given.shape}"
        raise InputError(
            f"a reading must be one excess conductance, or the {INPUTS} inputs of one sample, "
            f"without NaN; got {got}"
        )
    return given[None, :]


def _samples(readings: Any, force_n: ArrayLike) -> tuple[FloatArray, FloatArray]:
    force = np.asarray(force_n, dtype=float)
    if len(readings) != force.size or force.ndim != 1 or not force.size:
        raise CalibrationError(f"{len(readings)} readings for {force.size} measured forces")
    if not (np.isfinite(force).all() and (force > 0).all()):
        raise CalibrationError("force calibration: a measured force is not above 0; omit it")
    inputs = np.concatenate([_inputs(reading) for reading in readings])
    if not np.isfinite(inputs).all():
        raise CalibrationError(
            "force calibration: a reading is infinite, as of a saturated pixel; omit it, or use a "
            "smaller reference resistor"
        )
    return inputs, np.log(force)
