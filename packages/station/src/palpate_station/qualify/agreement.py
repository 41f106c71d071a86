"""Agreement of grasps with a reference instrument, and the ceiling that the reference sets."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtr

from palpate.arrays import FloatArray
from palpate.measurement import half_width_sds
from palpate_station.qualify.readings import FEWEST_ITEMS, PairedReadings
from palpate_station.qualify.scatter import Scatter, deming_lines, estimate_scatter

#: Draws of the bootstrap over items, and its seed.
_DRAWS, _SEED = 1000, 0
#: Unrelated instruments correlate as much with at most this probability. The bootstrap alone took
#: 3 of 60 unrelated pairs of 10 to 80 items for related, also at a level of 99 %.
_CHANCE = 0.01
#: Two-sided quantile of the limits of agreement: 95 % of the differences (Bland and Altman 1986).
_LIMITS = half_width_sds(0.95)


@dataclass(frozen=True, slots=True, kw_only=True)
class Demand:
    """A buyer's demands on the instrument.

    Attributes
    ----------
    tolerance : float
        Accepted difference from the reference, in the reference's unit.
    limits : tuple of float
        Limits between grades, ascending, in the reference's unit; empty without grades.
    level : float
        Probability of each interval, and fraction of items that must be within the tolerance.
    cost_high, cost_low : float
        Cost per grade of error for an item graded too high, and for an item graded too low.
    """

    tolerance: float
    limits: tuple[float, ...] = ()
    level: float = 0.9
    cost_high: float = 1.0
    cost_low: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A figure with its interval from the bootstrap over items; NaN if unknown."""

    value: float
    low: float = math.nan
    high: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Agreement:
    """Agreement of grasps with the reference, from paired readings.

    Attributes
    ----------
    figures : mapping of str to Estimate
        Figures by the names in `FIGURES`; those of the conversion are unknown without a relation.
    correlation : Estimate
        Correlation of the two instruments' means over the items.
    is_related : bool
        Whether the grasps are related to the reference: the correlation is significant at 1 %, its
        interval excludes 0, and converted grasps differ less from the reference than readings of
        two random items.
    reference, grasp : Scatter
        Scatter of the reference and of the grasps, both in the reference's unit.
    slope, offset : float
        Reference = offset + slope x grasp, from Deming regression.
    read, converted : ndarray, shape (n_pairs,)
        Reference reading and converted grasp of each pair. The conversion uses the line of the
        other items, which avoids a bias of the differences.
    """

    figures: Mapping[str, Estimate]
    correlation: Estimate
    is_related: bool
    reference: Scatter
    grasp: Scatter
    slope: float
    offset: float
    read: FloatArray
    converted: FloatArray

    @property
    def difference(self) -> FloatArray:
        """Converted grasp minus reference for each pair, shape (n_pairs,)."""
        return self.converted - self.read


#: Name of a figure -> meaning, as the table shows it.
FIGURES = {
    "limit_of_agreement": "limit of agreement: 95 % of differences are smaller",
    "r_squared": "R squared of single readings",
    "r_squared_ceiling": "maximum R squared of any instrument, from the reference's own scatter",
    "share_within": "grasps within the tolerance of the reference",
    "share_within_ceiling": "error-free instrument within the tolerance of the reference",
    "share_within_reference": "second reference reading within the tolerance of the first",
    "same_grade": "grasps in the grade of the reference",
    "same_grade_reference": "second reference reading in the grade of the first",
    "cost": "cost of wrong grades per item, by grasps",
    "cost_reference": "cost of wrong grades per item, by a second reference reading",
}
#: Figures of grasps that were converted to the reference's unit.
_OF_CONVERSION = ("limit_of_agreement", "share_within", "same_grade", "cost")


def measure_agreement(readings: PairedReadings, demand: Demand) -> Agreement:
    """Return the agreement of grasps with the reference, and the ceiling of any instrument.

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
    >>> found = measure_agreement(readings, Demand(tolerance=5.0))
    >>> round(found.figures["r_squared_ceiling"].value, 1), round(found.slope)
    (0.8, 2)
    """
    measured = calculate_agreement(readings, demand)
    correlation = measured.correlation
    random = np.random.default_rng(_SEED)
    draws = []
    for _ in range(_DRAWS):
        drawn = readings.select(random.integers(readings.items, size=readings.items))
        if np.unique(drawn.item[drawn.has_both]).size >= FEWEST_ITEMS // 2:
            draws.append(calculate_agreement(drawn, demand))
    tail = (1.0 - demand.level) / 2.0

    def with_interval(estimate: Estimate, drawn: list[float]) -> Estimate:
        """Return an estimate with the interval of its draws."""
        known = np.array(drawn)[np.isfinite(drawn)]
        if not (math.isfinite(estimate.value) and known.size):
            return estimate
        low, high = map(float, np.quantile(known, [tail, 1.0 - tail]))
        return replace(estimate, low=low, high=high)

    correlation = with_interval(correlation, [draw.correlation.value for draw in draws])
    is_related = measured.is_related and correlation.low * correlation.high > 0
    figures = {
        name: with_interval(estimate, [draw.figures[name].value for draw in draws])
        if is_related or name not in _OF_CONVERSION
        else Estimate(value=math.nan)
        for name, estimate in measured.figures.items()
    }
    return replace(measured, figures=figures, correlation=correlation, is_related=is_related)


def calculate_agreement(readings: PairedReadings, demand: Demand) -> Agreement:
    """Return the agreement without intervals; arguments as in `measure_agreement`."""
    reference = estimate_scatter(readings.reference, readings.item)
    raw = estimate_scatter(readings.grasp, readings.item)
    paired = readings.has_both
    grasp, read = readings.grasp[paired], readings.reference[paired]
    # Index of each pair's item among the items with both readings.
    _, index, count = np.unique(readings.item[paired], return_inverse=True, return_counts=True)
    means = [np.bincount(index, weights=values) / count for values in (grasp, read)]
    ratio = (reference.within / raw.within) ** 2 if raw.within > 0 else math.nan
    slope, offset = (float(one) for one in deming_lines(*means, ratio=ratio))
    slopes, offsets = deming_lines(*means, ratio=ratio, leave_out=True)
    converted = offsets[index] + slopes[index] * grasp
    difference = converted - read
    first, second = _pair_repeats(readings)
    figures = {
        "limit_of_agreement": _LIMITS * float(difference.std(ddof=1)),
        "r_squared": _r_squared(grasp, read),
        "r_squared_ceiling": reference.repeatability,
        "share_within": _fraction(np.abs(difference) <= demand.tolerance),
        "share_within_ceiling": reference.fraction_within(demand.tolerance),
        "share_within_reference": _fraction(np.abs(first - second) <= demand.tolerance),
    }
    if demand.limits:
        grades = [np.digitize(one, demand.limits) for one in (converted, read, first, second)]
        figures["same_grade"] = _fraction(grades[0] == grades[1])
        figures["same_grade_reference"] = _fraction(grades[2] == grades[3])
        figures["cost"] = _mean_cost(grades[0] - grades[1], demand)
        # The order of the two readings is arbitrary, so both orders count.
        errors = np.concatenate([grades[3] - grades[2], grades[2] - grades[3]])
        figures["cost_reference"] = _mean_cost(errors, demand)
    spread = float(read.std(ddof=1)) if read.size > 1 else math.nan
    return Agreement(
        figures={name: Estimate(value=value) for name, value in figures.items()},
        correlation=Estimate(value=_correlation(*means)),
        # The difference of two random items has sqrt(2) times their standard deviation. A larger
        # one means that the line is steeper than any relation in the readings.
        is_related=_find_chance(*means) < _CHANCE
        and bool(difference.std(ddof=1) < math.sqrt(2.0) * spread),
        reference=reference,
        grasp=Scatter(between=abs(slope) * raw.between, within=abs(slope) * raw.within),
        slope=slope,
        offset=offset,
        read=read,
        converted=converted,
    )


def count_grades(found: Agreement, limits: tuple[float, ...]) -> NDArray[np.int64]:
    """Count pairs by the grades of reference (rows) and grasp (columns); empty without limits."""
    table = np.zeros((len(limits) + 1, len(limits) + 1), dtype=np.int64)
    np.add.at(table, (np.digitize(found.read, limits), np.digitize(found.converted, limits)), 1)
    return table if limits else table[:0, :0]


def _pair_repeats(readings: PairedReadings) -> tuple[FloatArray, FloatArray]:
    """Return the first two reference readings of each item with at least two."""
    read = np.isfinite(readings.reference)
    item, value = readings.item[read], readings.reference[read]
    order = np.argsort(item, kind="stable")
    item, value = item[order], value[order]
    starts = np.flatnonzero(np.concatenate(([True], item[1:] != item[:-1])))
    twice = starts[np.diff(np.append(starts, item.size)) > 1]
    return value[twice], value[twice + 1]


def _r_squared(x: FloatArray, y: FloatArray) -> float:
    return _correlation(x, y) ** 2


def _correlation(x: FloatArray, y: FloatArray) -> float:
    if x.size < 2 or np.ptp(x) == 0 or np.ptp(y) == 0:
        return math.nan
    return float(np.corrcoef(x, y)[0, 1])


def _find_chance(x: FloatArray, y: FloatArray) -> float:
    """Return the probability of such a correlation between independent values (t test)."""
    correlation, freedom = _correlation(x, y), x.size - 2
    if not (freedom > 0 and abs(correlation) < 1.0):
        return 0.0 if abs(correlation) == 1.0 else 1.0
    t = correlation * math.sqrt(freedom / (1.0 - correlation**2))
    return 2.0 * float(stdtr(freedom, -abs(t)))


def _mean_cost(grade_errors: NDArray[np.int64], demand: Demand) -> float:
    """Return the mean cost of items graded too high (error above 0) or too low."""
    if not grade_errors.size:
        return math.nan
    costs = np.where(grade_errors > 0, demand.cost_high, demand.cost_low) * np.abs(grade_errors)
    return float(costs.mean())


def _fraction(values: NDArray[np.bool_]) -> float:
    return float(values.mean()) if values.size else math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class Effort:
    """Number of readings, grasps and items needed to meet a demand.

    Attributes
    ----------
    reference_readings, grasps : int or None
        Number of readings per item for a mean within the tolerance of the item's true value; None
        if no number is sufficient.
    mismatch : float
        Standard deviation from the difference of the two quantities; repeats do not reduce it. NaN
        without a relation.
    items_per_hour : float or None
        Rate with this number of grasps.
    items_to_test : int or None
        Number of items for an uncertainty of each limit of agreement of half the tolerance; None
        without a relation.
    """

    reference_readings: int | None
    grasps: int | None
    mismatch: float
    items_per_hour: float | None
    items_to_test: int | None


def estimate_effort(
    found: Agreement, demand: Demand, *, grasp_s: float, handling_s: float
) -> Effort:
    """Return the number of readings, grasps and items needed to meet a demand.

    Parameters
    ----------
    found : Agreement
        Agreement of the readings.
    demand : Demand
        Tolerance and level.
    grasp_s, handling_s : float
        Duration of each grasp, and handling time per item, in seconds.

    References
    ----------
    J. M. Bland, D. G. Altman, Lancet 327 (1986) 307: a limit of agreement has the standard error
    sqrt(3 / n) times the standard deviation of the differences.

    Examples
    --------
    >>> random = np.random.default_rng(3)
    >>> item = np.repeat(np.arange(60), 2)
    >>> firmness = random.normal(70, 6, 60)[item]
    >>> readings = PairedReadings(
    ...     item=item,
    ...     reference=firmness + random.normal(0, 3, 120),
    ...     grasp=firmness + random.normal(0, 1, 120),
    ... )
    >>> demand = Demand(tolerance=3.0)
    >>> agreement = measure_agreement(readings, demand)
    >>> effort = estimate_effort(agreement, demand, grasp_s=15, handling_s=5)
    >>> effort.reference_readings, effort.grasps, effort.items_per_hour
    (3, 1, 180.0)
    """
    quantile = half_width_sds(demand.level)
    spread = float(found.difference.std(ddof=1)) if found.is_related else math.nan
    # The differences contain the scatter of both instruments and their mismatch.
    known = sum(s.within**2 for s in (found.reference, found.grasp) if math.isfinite(s.within))
    mismatch = math.sqrt(max(0.0, spread**2 - known)) if found.is_related else math.nan

    def count_needed_readings(within: float, fixed: float) -> int | None:
        allowed = (demand.tolerance / quantile) ** 2 - fixed**2
        if not allowed > 0 or not math.isfinite(within):
            return None
        return max(1, math.ceil(within**2 / allowed))

    grasps = count_needed_readings(found.grasp.within, mismatch)
    return Effort(
        reference_readings=count_needed_readings(found.reference.within, 0.0),
        grasps=grasps,
        mismatch=mismatch,
        items_per_hour=None if grasps is None else 3600.0 / (grasps * grasp_s + handling_s),
        items_to_test=math.ceil(3.0 * (quantile * spread / (demand.tolerance / 2.0)) ** 2)
        if found.is_related
        else None,
    )
