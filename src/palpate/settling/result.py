"""The result type and the interface of all predictors of the settled value."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.measurement import Status


@dataclass(frozen=True, slots=True, kw_only=True)
class SettledEstimate:
    """The predicted value at the horizon, for one hold or a batch of holds.

    Attributes
    ----------
    value, low, high : float or ndarray, shape (n_holds,)
        Prediction and limits of its interval, in the unit of the hold. The limits are NaN if the
        method has no interval (no calibration holds).
    level : float
        Nominal coverage probability of the interval.
    horizon_s : float
        Time of the settled value, on the hold's time axis.
    window_s : float or ndarray, shape (n_holds,)
        Duration of the samples used.
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
        """Return plain values: numbers for one hold, lists for a batch, None if unknown.

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
        """Return the estimate for one hold of a batch, with scalar fields."""
        if not isinstance(self.value, np.ndarray):
            return self
        names = ("value", "low", "high", "window_s", "status")
        # Several times as fast as `dataclasses.replace`.
        return SettledEstimate(
            **{name: getattr(self, name)[index] for name in names},
            level=self.level,
            horizon_s=self.horizon_s,
            method=self.method,
        )


def make_estimate(
    ends: FloatArray,
    status: NDArray[np.object_],
    window_s: FloatArray,
    *,
    horizon_s: float,
    level: float,
    name: str,
) -> SettledEstimate:
    """Return an estimate of a batch.

    `ends`: lower limit, value and upper limit, shape (3, n_holds); or the value, shape (n_holds,),
        of a method without an interval.
    """
    unknown = np.full(window_s.size, np.nan)
    low, value, high = ends if ends.ndim == 2 else (unknown, ends, unknown.copy())
    return SettledEstimate(
        value=value,
        low=low,
        high=high,
        level=level,
        horizon_s=horizon_s,
        window_s=window_s,
        method=name,
        status=status,
    )


def _plain(part: Any) -> Any:
    if isinstance(part, np.ndarray):
        return [_plain(element) for element in part]
    if isinstance(part, str):
        return str(part)
    return float(part) if np.isfinite(part) else None


class SettlingMethod(Protocol):
    """A predictor of the settled value for a batch of holds."""

    @property
    def name(self) -> str:
        """Name on the command line and in results."""
        ...

    def predict(
        self, time_s: FloatArray, values: FloatArray, *, horizon_s: float, level: float
    ) -> SettledEstimate:
        """Predict the value at the horizon from samples up to the cut-off.

        Parameters
        ----------
        time_s : ndarray, shape (n_times,)
            Strictly increasing sampling times of all holds, seconds.
        values : ndarray, shape (n_holds, n_times)
            Finite samples up to the cut-off, without later samples; at least one per hold.
        horizon_s : float
            Time of the value to predict.
        level : float
            Coverage probability of the interval.

        Returns
        -------
        SettledEstimate
            Arrays of shape (n_holds,). `value` is always finite.
        """
        ...
