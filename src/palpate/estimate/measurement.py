"""A value with its unit, interval and status: what every estimator of the object returns."""

from __future__ import annotations

from dataclasses import dataclass

from palpate.settling.result import Status


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """One measured quantity.

    Attributes
    ----------
    value, low, high : float
        Estimate and the ends of its interval, in `unit`.
    unit : str
        As in names: ``"n"``, ``"mm"``, ``"n_per_mm"``, ``"percent"``.
    level : float
        Probability that the interval is meant to cover.
    status : Status
        `ok`, or why less can be promised.
    """

    value: float
    low: float
    high: float
    unit: str
    level: float = 0.9
    status: Status = Status.OK

    def as_json(self) -> dict[str, object]:
        """Return the form that commands print: value, low, high and status."""
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "status": str(self.status),
        }
