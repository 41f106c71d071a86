"""A hold: a stretch of one channel after the gripper stopped."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import require_extra

#: Stretch before the horizon whose mean counts as the settled value, seconds.
SETTLED_WINDOW_S = 0.5
#: Largest interval between samples around the horizon, as a fraction of the horizon.
_WIDEST_GAP_FRACTION = 0.25


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class Hold:
    """One channel of one hold.

    Attributes
    ----------
    hold_id : str
        Name in the file.
    channel : str or None
        Pixel or signal, if a hold has several.
    time_s : ndarray, shape (n_times,)
        Strictly increasing; 0 is the actuation or the peak. Sampling may be uneven.
    values : ndarray, shape (n_times,)
        In any unit.
    unit : str or None
        Unit of the values, if known; ``"percent"`` is a change relative to rest.
    """

    hold_id: str
    channel: str | None
    time_s: NDArray[np.float64]
    values: NDArray[np.float64]
    unit: str | None = None

    def __repr__(self) -> str:
        name = self.hold_id if self.channel is None else f"{self.hold_id}:{self.channel}"
        parts = [f"{self.time_s.size} samples"]
        if self.time_s.size:
            parts.append(f"{self.time_s[0]:g} to {self.time_s[-1]:g} s")
        if self.unit is not None:
            parts.append(self.unit)
        return f"Hold({name!r}, {', '.join(parts)})"

    def plot(self, axes: Any = None) -> Any:
        """Draw the samples on matplotlib axes, the current ones by default, and return the axes.

        Raises
        ------
        MissingExtraError
            If matplotlib is not installed.
        """
        with require_extra("a plot", extra="plots"):
            import matplotlib.pyplot as plt
        axes = plt.gca() if axes is None else axes
        axes.plot(self.time_s, self.values, label=self.hold_id)
        axes.set_xlabel("time (s)")
        axes.set_ylabel("value" if self.unit is None else f"value ({self.unit})")
        return axes


def measure_settled_value(
    time_s: NDArray[np.float64], values: NDArray[np.float64], *, horizon_s: float
) -> float:
    """Return the mean over 0.5 s before the horizon; NaN for a shorter hold.

    A sample covers the time up to the next sample. A hold therefore reaches the horizon if its last
    sample is at most one median interval before the horizon. Between the samples of a slow logger
    the value is interpolated; NaN if they are more than a quarter of the horizon apart.

    `horizon_s`: time of the settled value, seconds.

    >>> time_s = np.arange(0, 21, 0.25)
    >>> measure_settled_value(time_s, time_s, horizon_s=20.0)
    19.75
    >>> measure_settled_value(time_s, time_s, horizon_s=30.0)
    nan
    >>> measure_settled_value(np.array([17.0, 19.0, 21.0]), np.array([5.0, 4.0, 2.0]), horizon_s=20)
    3.25
    """
    median_interval_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    window = (time_s >= horizon_s - SETTLED_WINDOW_S) & (time_s <= horizon_s)
    # Tolerance for rounding: 19.95 + 0.05 is slightly less than 20.
    reached = time_s[-1] + median_interval_s >= horizon_s * (1 - 1e-9)
    if reached and window.any():
        return float(values[window].mean())
    after = int(np.searchsorted(time_s, horizon_s))
    if not 0 < after < len(time_s):
        return float("nan")
    before_s, after_s = time_s[after - 1], time_s[after]
    if after_s - before_s > _WIDEST_GAP_FRACTION * horizon_s:
        return float("nan")
    return float(np.interp(horizon_s - SETTLED_WINDOW_S / 2, time_s, values))


def find_recorded_value(
    time_s: NDArray[np.float64], values: NDArray[np.float64], *, cutoff_s: float
) -> float:
    """Return the last sample up to the cut-off; NaN if there is none.

    >>> find_recorded_value(np.array([0.0, 1.0, 2.0]), np.array([9.0, 8.0, 7.0]), cutoff_s=1.5)
    8.0
    """
    count = int(np.searchsorted(time_s, cutoff_s, side="right"))
    return float(values[count - 1]) if count else float("nan")
