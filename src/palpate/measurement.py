"""Measurement: a value with unit, interval and status, as returned by all estimators.

It is the only module that converts an interval to a standard deviation, and back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum


class Status(StrEnum):
    """Validity of an estimate.

    Attributes
    ----------
    OK : "ok"
        The interval is reliable: it is supported by holds of this sensor, or the shape is well
        within the range of real materials.
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


#: Largest ratio of the interval's limits for a value to be reported.
MOST_RATIO = 4.0
#: Statuses without a value, and whether the lower and upper limit are known.
_ENDS = {
    Status.AT_LEAST: (True, False),
    Status.AT_MOST: (False, True),
    Status.NOT_MEASURED: (False, False),
}


#: Symbols of units.
_SYMBOLS = {"n": "N", "n_per_mm": "N/mm", "kpa": "kPa", "percent": "%", "ohm": "Ω"}


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
