"""Force now from the sheet's history: a power law with linear memory, as a regression.

ln force = w . [1, x, x - x1, ..., x - x6, fall, curve], with x the logarithm of the excess
conductance, x1 to x6 its low-passed copies and `fall` the fall from its recent maximum. The weights
w of a contact are a Gaussian variable: before any force is known their mean and spread are those of
other sensors (the population), every known force is one Kalman update, and the interval follows
from what is left of the spread and from the scatter about the law.
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
from scipy.special import ndtri

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, InputError
from palpate.estimate.force_states import CONTACT_EXCESS, TIME_CONSTANTS_S, log_reading
from palpate.estimate.measurement import Measurement

#: Inputs of a sample: the reading, its difference from each copy, and the fall.
INPUTS = 2 + len(TIME_CONSTANTS_S)
#: Standardised inputs beyond this lie outside of all that was learned from; the law is extended as
#: a constant there.
_FARTHEST = 4.0
#: Below the weakest force learned the interval of ln force grows, by at most this factor (guess).
_MOST_FAINT = 4.0
#: Samples of one contact repeat each other: together they count as at most this many (error of
#: strokes given the place: 15 to 30 alike, 5 and 60 worse).
MOST_SAMPLES = 25.0
#: On a steep rise one force shows the gain of a contact, and little of its memory: an error of
#: timing resembles memory. There the weights other than the constant take this fraction of a full
#: update (share 1: strokes .110/.225 and presses .045; .3: .103/.201 and .028).
MEMORY_FRACTION = 0.3
#: A reading rises where ln excess is this far from its copy of 0.1 s (the third input after x).
_RISING, _COPY = 0.05, 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Population:
    """What sensors of one kind have in common; learned by `palpate study force-population`.

    Attributes
    ----------
    centre, scale : ndarray, shape (INPUTS + 1,)
        Mean and standard deviation of the inputs, and of the curve.
    mean : ndarray, shape (INPUTS + 3,)
        Weights: of 1, of the standardised inputs, and of having measured a force in this contact.
    spread : ndarray, shape (INPUTS + 3, INPUTS + 3)
        Covariance of the weights over sensors and places.
    contact_spread : ndarray, shape (INPUTS + 3, INPUTS + 3)
        Covariance of their change from one contact to the next at one place.
    noise : ndarray, shape (4,)
        Logarithm of the scatter of ln force: of 1, the reading, its speed and the fall.
    least_n : float
        Weakest force learned from, newtons; below it the scatter stays the same in newtons.
    """

    centre: FloatArray
    scale: FloatArray
    mean: FloatArray
    spread: FloatArray
    contact_spread: FloatArray
    noise: FloatArray
    least_n: float

    def as_dict(self) -> dict[str, Any]:
        """Return plain values; `population_from_dict` reads them back."""
        return {
            one.name: np.asarray(getattr(self, one.name)).tolist() for one in fields(Population)
        }

    def design(self, inputs: ArrayLike, *, given: bool) -> FloatArray:
        """Return the regressors of samples, shape (n, INPUTS) to (n, INPUTS + 3).

        `given`: whether a force was measured earlier in the same contact.
        """
        z = standardise(np.asarray(inputs, dtype=float), centre=self.centre, scale=self.scale)
        return np.column_stack([np.ones(len(z)), z, np.full(len(z), float(given))])

    def variance(self, design: FloatArray) -> FloatArray:
        """Return the variance of ln force about the law at samples, shape (n,)."""
        return np.asarray(np.exp(2.0 * np.clip(noise_inputs(design) @ self.noise, -4.0, 0.5)))


def standardise(inputs: FloatArray, *, centre: FloatArray, scale: FloatArray) -> FloatArray:
    """Return inputs with the curve, standardised and clipped, shape (n, INPUTS + 1)."""
    z = (with_curve(inputs) - centre) / scale
    return np.asarray(np.clip(z, -_FARTHEST, _FARTHEST))


def with_curve(inputs: FloatArray) -> FloatArray:
    """Return inputs with the reading's square, as a saturating sheet bends the power law."""
    return np.column_stack([inputs, np.maximum(inputs[:, 0], 0.0) ** 2])


def noise_inputs(design: FloatArray) -> FloatArray:
    """Return what the scatter depends on, shape (n, 4): 1, reading, speed, fall."""
    speed = np.abs(design[:, 4])
    return np.column_stack([design[:, 0], design[:, 1], speed, design[:, INPUTS]])


def scale_memory(spread: FloatArray, fraction: float) -> FloatArray:
    """Return a covariance of weights with less spread of all but the constant."""
    factor = np.full(len(spread), fraction)
    factor[0] = 1.0
    return spread * np.outer(factor, factor)


class ForceLaw:
    """Newtons with an interval from a sheet's reading, at any time of a contact.

    A reading is the inputs of one sample, as `ForceStates` makes them, or an excess conductance
    G/G0 - 1 summed over pixels, which counts as settled.

    Attributes
    ----------
    population : Population
        Where the law starts.
    mean, covariance : ndarray, shape (INPUTS + 3,) and (INPUTS + 3, INPUTS + 3)
        Of the weights in the present contact.
    known : int
        Forces that it was updated with.
    least_n : float
        Weakest force known, newtons: where less is read, none at all is possible too.

    Examples
    --------
    Three dead weights on a new sheet narrow the interval:

    >>> law = ForceLaw()
    >>> before = law.force(40.0)
    >>> law = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    >>> after = law.force(40.0)
    >>> after.low < 9.0 < after.high, after.high / after.low < 0.5 * before.high / before.low
    (True, True)
    """

    name: ClassVar[str] = "linear-memory"

    def __init__(self, population: Population | None = None) -> None:
        self.population = load_population() if population is None else population
        self.mean, self.covariance = self.population.mean, self.population.spread
        self.known, self.least_n, self._given = 0, self.population.least_n, False

    @classmethod
    def fit(
        cls,
        readings: Sequence[Any] | FloatArray,
        *,
        force_n: ArrayLike,
        contact: Sequence[object] | None = None,
        population: Population | None = None,
    ) -> Self:
        """Return the law of a sheet with measured forces, ready for its next contact.

        Parameters
        ----------
        readings : sequence of readings, length n
            See the class.
        force_n : array_like, shape (n,)
            Measured forces, newtons, above 0.
        contact : sequence, length n, optional
            Samples of one contact share its name, and later contacts count more. By default each
            sample is a contact of its own, as of weights laid down one by one, and all count alike.
        population : Population, optional
            Where to start; the one that palpate ships by default.

        Raises
        ------
        CalibrationError
            If a force is not above 0, a reading or force is not finite, or lengths differ.
        """
        law = cls(population)
        inputs, log_n = _samples(readings, force_n)
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
        return law

    def copy(self) -> Self:
        """Return the law as it is, to be updated on its own."""
        other = type(self)(self.population)
        other.mean, other.covariance = self.mean, self.covariance
        other.known, other.least_n, other._given = self.known, self.least_n, self._given
        return other

    def begin_contact(self) -> None:
        """Widen the law: the sheet is touched again, perhaps at another place of the object."""
        self.covariance = self.covariance + self.population.contact_spread
        self._given = False

    def update(self, reading: Any, *, force_n: ArrayLike, sd_n: float = 0.0) -> Self:
        """Take in a force measured in the present contact, and return the law itself.

        `reading`: one reading, or a sequence of them with as many forces.
        `force_n`: by a dead weight, a load cell or a servo's current, newtons, above 0.
        `sd_n`: standard deviation of that measurement.
        Raises `CalibrationError` as `fit`.
        """
        many = np.ndim(force_n) > 0
        inputs, log_n = _samples(reading if many else [reading], np.atleast_1d(force_n))
        rising = bool((np.abs(inputs[:, _COPY]) > _RISING).any())
        self._update_weights(
            inputs, log_n, sd=sd_n * np.exp(-log_n), memory=MEMORY_FRACTION if rising else 1.0
        )
        self._given = True
        return self

    def log_force(self, inputs: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return mean and standard deviation of ln force (N) of samples, shape (n, INPUTS)."""
        design = self.population.design(inputs, given=self._given)
        mean = design @ self.mean
        spread = np.einsum("ni,ij,nj->n", design, self.covariance, design)
        faint = np.clip(self.population.least_n / np.exp(mean), 1.0, _MOST_FAINT)
        return mean, faint * np.sqrt(spread + self.population.variance(design))

    def force(
        self, reading: Any, *, level: float = 0.9, touched: bool | None = None
    ) -> Measurement:
        """Return the force at a reading; 0 with an upper end without contact.

        `touched`: whether something does; by default the reading shows it.
        """
        inputs = _inputs(reading)
        (mean,), (sd,) = self.log_force(inputs)
        value, half_width = float(np.exp(mean)), float(ndtri(0.5 + level / 2)) * sd
        if touched is None:
            touched = bool(inputs[0, 0] > np.log(2.0 * CONTACT_EXCESS))
        return Measurement(
            value=value if touched else 0.0,
            low=float(np.exp(mean - half_width)) if touched and value >= self.least_n else 0.0,
            high=float(np.exp(mean + half_width)),
            unit="n",
            level=level,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file; `from_dict` reads them back."""
        return {
            "law": self.name,
            "known": self.known,
            "least_n": self.least_n,
            "weights": self.mean.tolist(),
            "covariance": self.covariance.tolist(),
            "population": self.population.as_dict(),
        }

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Self:
        """Return the law that `as_dict` wrote.

        Raises `CalibrationError` if it is of another kind, or a value is missing or misshapen.

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
        except (KeyError, TypeError, ValueError) as error:
            raise CalibrationError(f"force law: {error}; calibrate the force again") from error
        return law

    def _update_weights(
        self,
        inputs: FloatArray,
        log_n: FloatArray,
        *,
        sd: ArrayLike = 0.0,
        memory: float = 1.0,
        other_contact: bool = False,
    ) -> None:
        """Update the weights with samples of one contact (Kalman); `memory`: `MEMORY_FRACTION`."""
        design = self.population.design(inputs, given=self._given)
        repeats = max(len(log_n) / MOST_SAMPLES, 1.0)
        noise = repeats * (self.population.variance(design) + np.asarray(sd) ** 2)
        gain = scale_memory(self.covariance, memory) @ design.T
        scatter = np.diag(noise)
        if other_contact:
            # What this contact has of its own is shared by its samples, and no part of the place.
            scatter += design @ self.population.contact_spread @ design.T
        weight = np.linalg.solve(design @ gain + scatter, gain.T).T
        self.mean = self.mean + weight @ (log_n - design @ self.mean)
        # In Joseph's form, which holds for any gain.
        left = np.eye(len(self.mean)) - weight @ design
        self.covariance = left @ self.covariance @ left.T + weight @ scatter @ weight.T
        self.known += len(log_n)
        self.least_n = min(self.least_n, float(np.exp(log_n.min())))


@cache
def load_population() -> Population:
    """Return the population that palpate ships; `palpate study force-population` learns it."""
    stored = files("palpate.estimate").joinpath("force_population.json").read_text("utf-8")
    return population_from_dict(json.loads(stored))


def population_from_dict(stored: Mapping[str, Any]) -> Population:
    """Return a population from plain values; raises `KeyError` or `ValueError` if one is wrong."""
    curved, all_weights = (INPUTS + 1,), (INPUTS + 3,)
    shapes = {"centre": curved, "scale": curved, "mean": all_weights, "noise": (4,)}
    square = (INPUTS + 3, INPUTS + 3)
    names = [one.name for one in fields(Population) if one.name != "least_n"]
    arrays = {name: _shape(stored[name], shapes.get(name, square)) for name in names}
    return Population(**arrays, least_n=float(stored["least_n"]))


def _shape(values: Any, shape: tuple[int, ...]) -> FloatArray:
    array = np.asarray(values, dtype=float)
    if array.shape != shape or not np.isfinite(array).all():
        raise ValueError(f"an array of shape {array.shape} in place of finite numbers {shape}")
    return array


def build_settled_inputs(excess: ArrayLike) -> FloatArray:
    """Return settled readings of excess conductance as inputs, shape (n,) to (n, INPUTS).

    >>> build_settled_inputs([0.9])[:, :2].tolist()
    [[0.0, 0.0]]
    """
    readings = np.atleast_1d(log_reading(excess))
    inputs = np.zeros((len(readings), INPUTS))
    inputs[:, 0] = readings
    return inputs


def _inputs(reading: Any) -> FloatArray:
    """Return one reading as inputs, shape (1, INPUTS)."""
    given = np.asarray(reading, dtype=float)
    if given.ndim == 0 and not np.isnan(given):
        return build_settled_inputs(given)
    if given.shape != (INPUTS,) or np.isnan(given).any():
        raise InputError(
            f"a reading is an excess conductance or the {INPUTS} inputs of a sample, without NaN; "
            f"got shape {given.shape}"
        )
    return given[None, :]


def _samples(readings: Any, force_n: ArrayLike) -> tuple[FloatArray, FloatArray]:
    force = np.asarray(force_n, dtype=float)
    if len(readings) != force.size or force.ndim != 1 or not force.size:
        raise CalibrationError(f"{len(readings)} readings for {force.size} measured forces")
    if not (np.isfinite(force).all() and (force > 0).all()):
        raise CalibrationError("force calibration: a measured force is not above 0; leave it out")
    return np.concatenate([_inputs(reading) for reading in readings]), np.log(force)
