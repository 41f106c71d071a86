"""The force laws that the ladders compare: the paper's line, a plain power law, ours."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student_t

from palpate.estimate.force import ForceEstimate
from palpate.estimate.population_law import PopulationForceLaw

FloatArray: TypeAlias = NDArray[np.float64]
Predicted: TypeAlias = ForceEstimate

#: Loaded readings are taken to show at least this share of the conductance at rest.
SMALLEST_EXCESS = 0.01
#: Least step of the logger that the ladders were read with, ohm: 620 ohm divider, 10 bit.
READING_STEP_OHM = 0.606


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
    def relative_percent(self) -> FloatArray:
        """Relative change of resistance (eq. 1), percent."""
        return (self.resistance_ohm / self.rest_ohm - 1) * 100


def line(
    one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_], level: float
) -> Predicted:
    """Predict by the paper's line: slope from the other ladders, intercept from the steps told."""
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
    """Predict by a power law: exponent from the other ladders, gain from the steps told."""
    value, half = _shared_slope(
        [(np.log(ladder.excess_s), np.log(ladder.load_n)) for ladder in others],
        (np.log(one.excess_s), np.log(one.load_n)),
        told=told,
        level=level,
    )
    return ForceEstimate(
        value=np.exp(value),
        low=np.exp(value - half),
        high=np.exp(value + half),
        in_range=np.ones(value.shape, dtype=bool),
        level=level,
    )


def ours(
    one: Ladder, others: Sequence[Ladder], *, told: NDArray[np.bool_], level: float
) -> Predicted:
    """Predict by a law drawn from the population of the other ladders; see `PopulationForceLaw`."""
    population = PopulationForceLaw.fit(
        [ladder.excess_s for ladder in others], forces_n=[ladder.load_n for ladder in others]
    )
    law = population.calibrate(one.excess_s[told], force_n=one.load_n[told])
    digit = READING_STEP_OHM / one.resistance_ohm / np.sqrt(12)
    return law.force_n(one.excess_s, log_noise=digit, level=level)


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

MODELS: Mapping[str, Model] = {"line": line, "power": power, "ours": ours}
