"""Agreement of grasps with a reference instrument, and the ceiling that the reference sets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from palpate.arrays import FloatArray
from palpate.produce.qualify.line import deming_line, left_out_lines
from palpate.produce.qualify.readings import FEWEST_ITEMS, PairedReadings
from palpate.produce.qualify.scatter import Scatter, scatter_of

#: Draws of the bootstrap over items, and its seed.
_DRAWS, _SEED = 1000, 0
#: Two-sided quantile of the limits of agreement: 95 % of the differences (Bland and Altman 1986).
_LIMITS = float(norm.ppf(0.975))


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """What a buyer asks of the instrument.

    Attributes
    ----------
    tolerance : float
        Difference from the reference that is accepted, in the reference's unit.
    limits : tuple of float
        Limits between grades, rising, in the reference's unit; empty for none.
    level : float
        Probability of every interval, and share of items that must be within the tolerance.
    """

    tolerance: float
    limits: tuple[float, ...] = ()
    level: float = 0.9


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A figure with its interval by the bootstrap over items; NaN where it can't be had."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """What the readings show.

    Attributes
    ----------
    figures : mapping of str to Estimate
        By name: see `FIGURES`.
    reference, grasp : Scatter
        Of the reference, in its unit; of grasps, converted to the reference's unit.
    slope, offset : float
        Reference = offset + slope x grasp, by Deming regression.
    middle, difference : ndarray, shape (n_pairs,)
        Mean of the two instruments at each pair, and grasp less reference; grasps are converted by
        the line of the other items, so that the differences have no bias.
    confusion : ndarray of int, shape (n_grades, n_grades)
        Rows: grade by the reference; columns: by the grasp. Empty without limits.
    """

    figures: Mapping[str, Estimate]
    reference: Scatter
    grasp: Scatter
    slope: float
    offset: float
    middle: FloatArray
    difference: FloatArray
    confusion: FloatArray


#: Name of a figure -> meaning, as the table shows it.
FIGURES = {
    "limit_of_agreement": "limit of agreement: 95 % of differences are smaller",
    "r_squared": "R squared of single readings",
    "r_squared_ceiling": "R squared that no instrument can pass, by the reference's own scatter",
    "share_within": "share of readings within the tolerance",
    "share_within_ceiling": "the same for an instrument without any error",
    "share_within_reference": "the same for two readings of the reference on one item",
    "same_grade": "share of readings in the reference's grade",
    "same_grade_reference": "the same for two readings of the reference on one item",
}


def agreement_of(readings: PairedReadings, demand: Demand) -> Agreement:
    """Return how far grasps agree with the reference, and the ceiling of any instrument.

    Parameters
    ----------
    readings : PairedReadings
        At least eight items with both readings.
    demand : Demand
        Tolerance, grades and level.

    References
    ----------
    J. M. Bland, D. G. Altman, Lancet 327 (1986) 307; K. Linnet, Clin. Chem. 39 (1993) 424.

    Examples
    --------
    >>> random = np.random.default_rng(3)
    >>> item = np.repeat(np.arange(60), 2)
    >>> firmness = random.normal(70, 6, 60)[item]
    >>> readings = PairedReadings(
    ...     item=item,
    ...     reference=firmness + random.normal(0, 3, 120),
    ...     grasp=0.5 * firmness + random.normal(0, 1, 120),
    ... )
    >>> found = agreement_of(readings, Demand(tolerance=5.0))
    >>> round(found.figures["r_squared_ceiling"].value, 1), round(found.slope)
    (0.8, 2)
    """
    measured = measure(readings, demand)
    random = np.random.default_rng(_SEED)
    draws: list[dict[str, float]] = []
    for _ in range(_DRAWS):
        drawn = readings.drawn(random.integers(readings.items, size=readings.items))
        if np.unique(drawn.item[drawn.paired]).size >= FEWEST_ITEMS // 2:
            draws.append(measure(drawn, demand).figures)
    tail = (1.0 - demand.level) / 2.0
    figures = {}
    for name, value in measured.figures.items():
        known = np.array([draw[name] for draw in draws])
        known = known[np.isfinite(known)]
        low, high = (math.nan, math.nan)
        if math.isfinite(value) and known.size:
            low, high = (float(end) for end in np.quantile(known, [tail, 1.0 - tail]))
        figures[name] = Estimate(value=value, low=low, high=high)
    return Agreement(
        figures=figures,
        reference=measured.reference,
        grasp=measured.grasp,
        slope=measured.slope,
        offset=measured.offset,
        middle=measured.middle,
        difference=measured.difference,
        confusion=_confusion(measured, demand.limits),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """Everything that one set of readings gives, without intervals."""

    figures: dict[str, float]
    reference: Scatter
    grasp: Scatter
    slope: float
    offset: float
    middle: FloatArray
    difference: FloatArray


def measure(readings: PairedReadings, demand: Demand) -> Measured:
    """Return every figure of the readings, without intervals; arguments as `agreement_of`."""
    reference = scatter_of(readings.reference, readings.item)
    raw = scatter_of(readings.grasp, readings.item)
    x = _item_means(readings.grasp, readings)
    y = _item_means(readings.reference, readings)
    ratio = (reference.within / raw.within) ** 2 if raw.within > 0 else math.nan
    slope, offset = deming_line(x, y, ratio=ratio)
    slopes, offsets = left_out_lines(x, y, ratio=ratio)
    paired = readings.paired
    # Number of each pair's item among those with both readings.
    place = np.unique(readings.item[paired], return_inverse=True)[1]
    converted = offsets[place] + slopes[place] * readings.grasp[paired]
    read = readings.reference[paired]
    difference = converted - read
    first, second = _reference_twice(readings)
    figures = {
        "limit_of_agreement": _LIMITS * float(difference.std(ddof=1)),
        "r_squared": _r_squared(readings.grasp[paired], read),
        "r_squared_ceiling": reference.repeatability,
        "share_within": float((np.abs(difference) <= demand.tolerance).mean()),
        "share_within_ceiling": reference.share_within(demand.tolerance),
        "share_within_reference": _mean(np.abs(first - second) <= demand.tolerance),
    }
    if demand.limits:
        figures["same_grade"] = _mean(
            np.digitize(converted, demand.limits) == np.digitize(read, demand.limits)
        )
        figures["same_grade_reference"] = _mean(
            np.digitize(first, demand.limits) == np.digitize(second, demand.limits)
        )
    return Measured(
        figures=figures,
        reference=reference,
        grasp=Scatter(between=abs(slope) * raw.between, within=abs(slope) * raw.within),
        slope=slope,
        offset=offset,
        middle=(converted + read) / 2.0,
        difference=difference,
    )


def _confusion(measured: Measured, limits: Sequence[float]) -> FloatArray:
    if not limits:
        return np.zeros((0, 0))
    read = measured.middle - measured.difference / 2.0
    converted = measured.middle + measured.difference / 2.0
    table = np.zeros((len(limits) + 1, len(limits) + 1))
    np.add.at(table, (np.digitize(read, limits), np.digitize(converted, limits)), 1.0)
    return table


def _item_means(values: FloatArray, readings: PairedReadings) -> FloatArray:
    """Return the means of a reading over the pairs of each item that has pairs."""
    paired = readings.paired
    _, place, count = np.unique(readings.item[paired], return_inverse=True, return_counts=True)
    return np.bincount(place, weights=values[paired]) / count


def _reference_twice(readings: PairedReadings) -> tuple[FloatArray, FloatArray]:
    """Return the first two readings of the reference on each item that has two."""
    read = np.isfinite(readings.reference)
    item, value = readings.item[read], readings.reference[read]
    order = np.argsort(item, kind="stable")
    item, value = item[order], value[order]
    starts = np.flatnonzero(np.concatenate(([True], item[1:] != item[:-1])))
    twice = starts[np.diff(np.append(starts, item.size)) > 1]
    return value[twice], value[twice + 1]


def _r_squared(x: FloatArray, y: FloatArray) -> float:
    if np.ptp(x) == 0 or np.ptp(y) == 0:
        return math.nan
    return float(np.corrcoef(x, y)[0, 1] ** 2)


def _mean(values: np.ndarray[tuple[int, ...], np.dtype[np.bool_]]) -> float:
    return float(values.mean()) if values.size else math.nan
