"""Measurement: a value with unit, interval and status, as returned by all estimators.

It is the only module that converts an interval to a standard deviation, and back.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cache

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr, ndtri

from palpate.arrays import FloatArray


class Status(StrEnum):
    """Validity of an estimate.

    Attributes
    ----------
    OK : "ok"
        The interval is supported by holds of this sensor, or the shape is well within the range of
        real materials.
    UNPROVEN : "unproven"
        There are no holds of this sensor, and the shape is outside the range of real materials.
    TOO_SHORT : "too_short"
        Too few samples or too short a time.
    NOT_SETTLING : "not_settling"
        The reading returns, rises and falls, or is constant.
    SATURATED : "saturated"
        The readout is at an end of its range.
    FELL_BACK : "fell_back"
        The value is from a limit or from a simpler method.
    MISFIT : "misfit"
        No shape fits.
    AT_LEAST, AT_MOST : "at_least", "at_most"
        Only this limit of the interval is known.
    NOT_MEASURED : "not_measured"
        Neither limit is known.
    """

    OK = "ok"
    UNPROVEN = "unproven"
    TOO_SHORT = "too_short"
    NOT_SETTLING = "not_settling"
    SATURATED = "saturated"
    FELL_BACK = "fell_back"
    MISFIT = "misfit"
    AT_LEAST = "at_least"
    AT_MOST = "at_most"
    NOT_MEASURED = "not_measured"


#: A lower limit of 0 counts as this fraction of the value, to keep its logarithm finite.
_LEAST_FRACTION = 1e-3
#: Largest ratio of the interval's limits for a value to be reported.
MOST_RATIO = 4.0
#: Statuses without a value, and whether the lower and upper limit are known.
_ENDS = {
    Status.AT_LEAST: (True, False),
    Status.AT_MOST: (False, True),
    Status.NOT_MEASURED: (False, False),
}
#: Statuses without a value.
BOUNDS = frozenset(_ENDS)

#: Status of a falling function of a bound.
_FALLING = {Status.AT_LEAST: Status.AT_MOST, Status.AT_MOST: Status.AT_LEAST}
#: Symbols of units.
_SYMBOLS = {"n": "N", "n_per_mm": "N/mm", "kpa": "kPa", "percent": "%", "ohm": "Ω"}


@cache
def half_width_sds(level: float) -> float:
    """Return the half-width of an interval in standard deviations of a normal distribution.

    >>> round(half_width_sds(0.9), 4)
    1.6449
    """
    return float(ndtri(0.5 + level / 2))


def find_spread(errors: FloatArray, *, level: float = 0.9) -> float:
    """Return the standard deviation whose interval of a level contains that fraction of errors.

    `errors`, shape (n,): at least one. The quantile is conservative for a small sample (rank
    (n + 1) level), as in conformal prediction.

    >>> round(find_spread(np.array([0.3, -1.6449, 0.1])), 3)
    1.0
    """
    sizes = np.sort(np.abs(errors))
    rank = min(math.ceil(level * (sizes.size + 1)), sizes.size)
    return float(sizes[rank - 1]) / half_width_sds(level)


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """One measured quantity.

    Attributes
    ----------
    value : float or None
        Estimate, in `unit`; None if at most a bound is known.
    low, high : float
        Limits of the interval; `known_ends` omits limits that are not informative.
    unit : str
        Unit as in names: ``"n"``, ``"mm"``, ``"n_per_mm"``, ``"percent"``.
    level : float
        Nominal coverage of the interval.
    status : Status
        `ok`, or the limitation of the result. There is no value with `at_least`, `at_most` and
        `not_measured`.
    reason : str
        Reason for a missing value.
    """

    value: float | None
    low: float
    high: float
    unit: str
    level: float = 0.9
    status: Status = Status.OK
    reason: str = ""

    def __post_init__(self) -> None:
        if self.status in _ENDS:
            object.__setattr__(self, "value", None)

    def __repr__(self) -> str:
        value = "None" if self.value is None else f"{self.value:.4g}"
        unit = _SYMBOLS.get(self.unit, self.unit)
        return f"Measurement({value} {unit}, {self.low:.4g} to {self.high:.4g}, {self.status})"

    @property
    def has_value(self) -> bool:
        """Whether there is a value, and not only a bound."""
        return self.value is not None

    @property
    def middle(self) -> float:
        """The value, or the middle of the interval; geometric if both limits are positive."""
        if self.value is not None:
            return self.value
        if 0 < self.low <= self.high:
            return math.sqrt(self.low) * math.sqrt(self.high)
        return self.low / 2 + self.high / 2

    @property
    def known_ends(self) -> tuple[float | None, float | None]:
        """Limits of the interval; None for an unknown limit."""
        low, high = _ENDS.get(self.status, (True, True))
        return self.low if low else None, self.high if high else None

    @classmethod
    def from_log_sd(
        cls,
        value: float,
        *,
        log_sd: float,
        unit: str,
        level: float = 0.9,
        status: Status = Status.OK,
    ) -> Measurement:
        """Return a positive quantity with a standard deviation of its logarithm.

        >>> Measurement.from_log_sd(2.0, log_sd=0.1, unit="n")
        Measurement(2 N, 1.697 to 2.358, ok)
        """
        half = half_width_sds(level) * log_sd
        low, high = value * math.exp(-half), value * math.exp(half)
        return cls(value=value, low=low, high=high, unit=unit, level=level, status=status)

    @classmethod
    def from_samples(
        cls,
        values: ArrayLike,
        *,
        weight: ArrayLike,
        unit: str,
        level: float = 0.9,
        status: Status = Status.OK,
    ) -> Measurement:
        """Return median and central interval of weighted samples, both of shape (n,).

        >>> Measurement.from_samples(range(101), weight=[1.0] * 101, unit="mm")
        Measurement(50 mm, 4.55 to 95.45, ok)
        """
        samples, weights = np.asarray(values, dtype=float), np.asarray(weight, dtype=float)
        order, tail = np.argsort(samples), (1 - level) / 2
        reached = np.cumsum(weights[order]) - 0.5 * weights[order]
        low, value, high = np.interp(
            [tail, 0.5, 1 - tail], reached / weights.sum(), samples[order]
        ).tolist()
        return cls(value=value, low=low, high=high, unit=unit, level=level, status=status)

    @property
    def log_sd(self) -> float:
        """Standard deviation of the logarithm, from the width of the interval; infinite from 0.

        >>> round(Measurement.from_log_sd(2.0, log_sd=0.1, unit="n").log_sd, 6)
        0.1
        """
        if not (self.middle > 0 and self.high > 0):
            return math.inf
        low = max(self.low, _LEAST_FRACTION * self.middle)
        return math.log(self.high / low) / (2 * half_width_sds(self.level))

    @property
    def side_sds(self) -> tuple[float, float]:
        """Standard deviations below and above the value, from each side of the interval."""
        sds = half_width_sds(self.level)
        return (self.middle - self.low) / sds, (self.high - self.middle) / sds

    def probability_below(self, bound: float) -> float:
        """Return the probability of a quantity below a bound, normal on each side.

        >>> Measurement(value=4.0, low=3.0, high=6.0, unit="n").probability_below(6.0)
        0.95
        """
        below, above = self.side_sds
        sd = below if bound < self.middle else above
        return float(ndtr((bound - self.middle) / max(sd, 1e-9)))

    def quantile(self, probability: float) -> float:
        """Return the quantile of a probability between 0 and 1, normal on each side.

        >>> two = Measurement(value=4.0, low=3.0, high=6.0, unit="n")
        >>> two.quantile(0.5), round(two.quantile(0.95), 6)
        (4.0, 6.0)
        """
        sds = float(ndtri(probability))
        return self.middle + sds * self.side_sds[sds > 0]

    def mapped(self, function: Callable[[float], float], *, unit: str) -> Measurement:
        """Return a monotonic function of the quantity, in its unit.

        >>> Measurement(value=2.0, low=1.0, high=4.0, unit="n_per_mm").mapped(
        ...     lambda stiffness: 1.0 / stiffness, unit="mm_per_n"
        ... )
        Measurement(0.5 mm_per_n, 0.25 to 1, ok)
        """
        low, high, status = function(self.low), function(self.high), self.status
        if low > high:
            low, high, status = high, low, _FALLING.get(status, status)
        return replace(
            self, value=function(self.middle), low=low, high=high, unit=unit, status=status
        )

    def scaled(self, factor: float, *, unit: str) -> Measurement:
        """Return the quantity multiplied by a positive factor.

        >>> Measurement(value=2.0, low=1.0, high=4.0, unit="n").scaled(2.0, unit="n")
        Measurement(4 N, 2 to 8, ok)
        """
        return self.mapped(lambda end: factor * end, unit=unit)

    def widened(self, by: float = 0.0, *, sd: float = 0.0) -> Measurement:
        """Return the measurement with an independent uncertainty: half a width, or an sd.

        >>> Measurement(value=5.0, low=2.0, high=8.0, unit="n").widened(4.0)
        Measurement(5 N, 0 to 10, ok)
        """
        by, middle = math.hypot(by, half_width_sds(self.level) * sd), self.middle
        return replace(
            self,
            low=middle - math.hypot(middle - self.low, by),
            high=middle + math.hypot(self.high - middle, by),
        )

    def combined(self, other: Measurement, *, least: float) -> Measurement:
        """Return the geometric mean with another measurement of the same quantity.

        Half of their difference counts as an uncertainty, because their errors differ. A limit
        below `least` counts as `least`, to keep its logarithm finite.

        >>> one, other = (Measurement(value=v, low=v, high=v, unit="n") for v in (1.0, 4.0))
        >>> one.combined(other, least=1e-3)
        Measurement(2 N, 1 to 4, ok)
        """
        value = math.sqrt(self.middle * other.middle)
        apart = abs(math.log(self.middle / other.middle)) / 2.0
        ends = ((self.low, other.low), (self.high, other.high))
        middles = (self.middle, other.middle)
        down, up = (
            math.hypot(
                0.5
                * sum(
                    abs(math.log(max(end, least) / middle))
                    for end, middle in zip(pair, middles, strict=True)
                ),
                apart,
            )
            for pair in ends
        )
        return replace(self, value=value, low=value * math.exp(-down), high=value * math.exp(up))

    def or_bound(self, reason: str, *, least: float, most: float) -> Measurement:
        """Return a bound instead of the value if the interval is wide.

        Parameters
        ----------
        reason : str
            Reason for the wide interval.
        least, most : float
            Physical limits: a lower limit of at most `least`, or an upper limit of at least `most`,
            is not informative.

        Examples
        --------
        >>> wide = Measurement(value=6.0, low=3.0, high=40.0, unit="n_per_mm")
        >>> bound = wide.or_bound("the fingers deflect more", least=0.02, most=500.0)
        >>> bound.has_value, str(bound.status), bound.known_ends
        (False, 'at_least', (3.0, None))
        >>> bound
        Measurement(None N/mm, 3 to 40, at_least)
        """
        if self.low > 0 and self.high <= MOST_RATIO * self.low:
            return self
        status = Status.NOT_MEASURED
        if self.low > least:
            status = Status.AT_LEAST
        elif self.high < most:
            status = Status.AT_MOST
        return replace(self, status=status, reason=reason)

    def to_dict(self) -> dict[str, object]:
        """Return the JSON form, with null for unknown values."""
        low, high = self.known_ends
        return {
            "value": self.value,
            "low": low,
            "high": high,
            "status": str(self.status),
            "unit": self.unit,
            "level": self.level,
            "reason": self.reason or None,
        }

    def text(self, *, digits: int) -> str:
        """Return the value, or the bound in words.

        Examples
        --------
        >>> wide = Measurement(value=6.0, low=3.0, high=40.0, unit="n_per_mm")
        >>> wide.text(digits=1)
        '6.0'
        >>> wide.or_bound("wide", least=0.02, most=500.0).text(digits=1)
        'at least 3.0'
        """
        low, high = self.known_ends
        if self.value is not None:
            return f"{self.value:.{digits}f}"
        if low is not None:
            return f"at least {low:.{digits}f}"
        return "not measured" if high is None else f"at most {high:.{digits}f}"
