"""The result of every predictor of the settled value."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray


class Status(StrEnum):
    """How an estimate came about.

    Attributes
    ----------
    OK : "ok"
        The interval can be believed: this sensor's own holds prove it, or the shape is well inside
        of what real materials showed.
    UNPROVEN : "unproven"
        Without own holds, and no real material settled in such a shape.
    TOO_SHORT : "too_short"
        Too few samples or too little time.
    NOT_SETTLING : "not_settling"
        The reading comes back, wanders or does not move.
    SATURATED : "saturated"
        The readout is at an end of its range.
    FELL_BACK : "fell_back"
        A bound decided the value, or a simpler method did.
    MISFIT : "misfit"
        No shape fits.
    AT_LEAST, AT_MOST : "at_least", "at_most"
        Only that end of the interval is known.
    NOT_MEASURED : "not_measured"
        Neither end is known.
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


@dataclass(frozen=True, slots=True, kw_only=True)
class SettledEstimate:
    """The predicted value at the horizon, for one hold or a batch of them.

    Attributes
    ----------
    value, low, high : float or ndarray, shape (n_holds,)
        Prediction and the ends of its interval, in the unit of the hold. The ends are NaN where the
        method has no basis for an interval (no calibration holds).
    level : float
        Probability that the interval is meant to cover.
    horizon_s : float
        Time of the settled value, on the hold's own time axis.
    window_s : float or ndarray, shape (n_holds,)
        Length of the stretch of samples that the prediction rests on.
    method : str
        Name of the method.
    status : Status or ndarray of Status, shape (n_holds,)
        See `Status`.
    """

    value: np.float64 | FloatArray
    low: np.float64 | FloatArray
    high: np.float64 | FloatArray
    level: float
    horizon_s: float
    window_s: np.float64 | FloatArray
    method: str
    status: Status | NDArray[np.object_]

    def __repr__(self) -> str:
        what = f"{self.method}, at {self.horizon_s:g} s"
        if isinstance(self.value, np.ndarray):
            return f"SettledEstimate({self.value.size} holds, {what})"
        return (
            f"SettledEstimate({self.value:.6g}, {self.low:.6g} to {self.high:.6g}, {what}, "
            f"{self.status})"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values: numbers for one hold, lists for several, None where unknown.

        Examples
        --------
        >>> from palpate.settling.baselines import Recorded
        >>> found = Recorded().predict(
        ...     np.array([0.0, 1.0]), np.array([[9.0, 8.0]]), horizon_s=20.0, level=0.9
        ... )
        >>> found.to_dict()["value"], found.hold(0).to_dict()["value"]
        ([8.0], 8.0)
        """

        return {part.name: _plain(getattr(self, part.name)) for part in fields(self)}

    def hold(self, index: int) -> SettledEstimate:
        """Return the estimate of one hold of a batch, with scalar fields."""
        if not isinstance(self.value, np.ndarray):
            return self
        names = ("value", "low", "high", "window_s", "status")
        return replace(self, **{name: np.asarray(getattr(self, name))[index] for name in names})


def _plain(part: Any) -> Any:
    if isinstance(part, np.ndarray):
        return [_plain(one) for one in part]
    if isinstance(part, str):
        return str(part)
    return float(part) if np.isfinite(part) else None


class SettlingMethod(Protocol):
    """A predictor of the settled value: one file each, batched over holds."""

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        ...

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon from the given samples, all of which may count.

        Parameters
        ----------
        time_s : ndarray, shape (n_times,)
            Strictly increasing sampling times that all the holds share, seconds.
        values : ndarray, shape (n_holds, n_times)
            Samples up to the cut-off and not one beyond it; finite; at least one per hold.
        horizon_s : float
            Time of the value to predict.
        level : float
            Probability that the interval is to cover.

        Returns
        -------
        SettledEstimate
            Arrays of shape (n_holds,). `value` is finite always.
        """
        ...
