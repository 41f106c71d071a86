"""The force laws that the ladders compare: the paper's line, a plain power law, ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri
from scipy.stats import t as student_t

from palpate import ForceLaw
from palpate.arrays import FloatArray
from palpate.estimate.force import ForceEstimate
from palpate.estimate.force_law import inputs_when_settled
from palpate_studies.force_learning import KnownContact, learn_population

Predicted: TypeAlias = ForceEstimate

#: Loaded readings are taken to show at least this share of the conductance at rest.
SMALLEST_EXCESS = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Ladder:
    """The loaded steps of one sensor, in the order they were made.

    Attributes
    ----------
    name : str
        Of the sensor.
    step : ndarray of int, shape (n_steps,)
        Number of each step in the file.
    load_n, resistance_ohm : ndarray, shape (n_steps,)
        Dead weight and settled reading.
    rest_ohm : float
        Reading before the first load.
    """

    name: str
    step: NDArray[np.int_]
    load_n: FloatArray
    resistance_ohm: FloatArray
    rest_ohm: float

    @property
    def excess_s(self) -> FloatArray:
        """Excess conductance G - G0, siemens, above 0."""
        rest = 1 / self.rest_ohm
        return np.asarray(np.maximum(1 / self.resistance_ohm - rest, SMALLEST_EXCESS * rest))

    @property
    def inputs(self) -> FloatArray:
        """Settled readings as `palpate.ForceLaw` takes them, shape (n_steps, INPUTS)."""
        return inputs_when_settled(self.excess_s * self.rest_ohm)

    @property
    def relative_percent(self) -> FloatArray:
        """Relative change of resistance (eq. 1), percent."""
        return (self.resistance_ohm / self.rest_ohm - 1) * 100


def line(
    one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_], level: float
) -> Predicted:
    """Predict by the paper's line: slope from the other ladders, intercept from the steps given."""
    value, half = _shared_slope(
        [(ladder.relative_percent, ladder.load_n) for ladder in others],
        (one.relative_percent, one.load_n),
        told=told,
        level=level,
    )
    return ForceEstimate(
        value=np.maximum(value, 0.0),
        low=np.maximum(value - half, 0.0),
        high=np.maximum(value + half, 0.0),
        in_range=np.ones(value.shape, dtype=bool),
        level=level,
    )


def power(
    one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_], level: float
) -> Predicted:
    """Predict by a power law: exponent from the other ladders, gain from the steps given."""
    value, half = _shared_slope(
        [(np.log(ladder.excess_s), np.log(ladder.load_n)) for ladder in others],
        (np.log(one.excess_s), np.log(one.load_n)),
        told=told,
        level=level,
    )
    return _estimate(value, half, level=level)


def unweighed(
    one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_], level: float
) -> Predicted:
    """Predict by one power law of all other ladders, without any step of this one."""
    log_g, log_n = (
        np.concatenate([np.log(getattr(ladder, name)) for ladder in others])
        for name in ("excess_s", "load_n")
    )
    slope, offset = np.polyfit(log_g, log_n, 1)
    half = float(np.quantile(np.abs(log_n - slope * log_g - offset), level))
    return _estimate(slope * np.log(one.excess_s) + offset, half, level=level)


def ours(
    one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_], level: float
) -> Predicted:
    """Predict by `palpate.ForceLaw`: the population of the other ladders, and the steps given."""
    law = ForceLaw.fit(
        one.inputs[told],
        force_n=one.load_n[told],
        population=learn_population([known_contact(ladder) for ladder in others]),
    )
    value, sd = law.log_force(one.inputs)
    return _estimate(value, float(ndtri(0.5 + level / 2)) * sd, level=level)


def known_contact(ladder: Ladder) -> KnownContact:
    """Return a ladder as what a population is learned from."""
    count = len(ladder.load_n)
    return KnownContact(
        inputs=ladder.inputs,
        force_n=ladder.load_n,
        weight=np.ones(count),
        place=ladder.name,
    )


def _estimate(value: FloatArray, half: FloatArray | float, *, level: float) -> Predicted:
    return ForceEstimate(
        value=np.exp(value),
        low=np.exp(value - half),
        high=np.exp(value + half),
        in_range=np.ones(value.shape, dtype=bool),
        level=level,
    )


def _shared_slope(
    known: Sequence[tuple[FloatArray, FloatArray]],
    own: tuple[FloatArray, FloatArray],
    *,
    told: NDArray[np.bool_],
    level: float,
) -> tuple[FloatArray, FloatArray]:
    """Return value and half width of a line with a slope in common and an own intercept."""
    centred = [(x - x.mean(), y - y.mean()) for x, y in known]
    squares = float(sum(x @ x for x, _ in centred))
    slope = float(sum(x @ y for x, y in centred)) / squares
    freedom = sum(len(x) for x, _ in centred) - len(centred) - 1
    variance = float(sum(np.sum((y - slope * x) ** 2) for x, y in centred)) / freedom
    x, y = own
    away = x - x[told].mean()
    value = y[told].mean() + slope * away
    spread = variance * (1 + 1 / np.count_nonzero(told) + away**2 / squares)
    return value, student_t.ppf(0.5 + level / 2, freedom) * np.sqrt(spread)


Model: TypeAlias = Callable[..., Predicted]

MODELS: Mapping[str, Model] = {
    "line": line,
    "power": power,
    "pooled": unweighed,
    "ours": ours,
}
