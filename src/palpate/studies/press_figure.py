"""The best, the median and the worst press, as the observer and a static law followed them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.estimate.creep import FloatArray
from palpate.studies.press_data import Press

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """What a model said of a press, at each sample after the force was told.

    Attributes
    ----------
    press : Press
        The press.
    value_n, low_n, high_n : ndarray, shape (n_after,)
        Force and the ends of its interval, newtons.
    """

    press: Press
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """Seconds since the force was told."""
        trace = self.press.trace
        return np.asarray(trace.time_s[trace.told + 1 :] - trace.time_s[trace.told])

    @property
    def told_n(self) -> float:
        """Force that was told, newtons."""
        return float(self.press.trace.force_n[self.press.trace.told])

    @property
    def truth_n(self) -> FloatArray:
        """Force of the load cell, newtons."""
        return self.press.trace.force_n[self.press.trace.told + 1 :]

    @property
    def log_error(self) -> FloatArray:
        """ln(estimated / true force)."""
        return np.asarray(np.log(self.value_n / self.truth_n))

    @property
    def last_held_log_error(self) -> float:
        """Error at the last sample before the release; of the first where none was held."""
        return float(self.log_error[max(self.press.last_held - self.press.trace.told - 1, 0)])

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether the interval holds the true force."""
        return (self.low_n <= self.truth_n) & (self.truth_n <= self.high_n)


def draw_presses(observed: Sequence[Followed], static: Sequence[Followed]) -> Figure:
    """Draw the best, median and worst press of the observer, the static law's answer beside it."""
    from matplotlib.figure import Figure

    order = np.argsort([np.median(np.abs(one.log_error)) for one in observed])
    places = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    figure = Figure(figsize=(10.5, 3.4), layout="constrained")
    for panel, (name, place) in zip(figure.subplots(1, 3), places.items(), strict=True):
        _draw_press(panel, observed[place], static[place])
        press = observed[place].press
        panel.set_title(f"{name}: {press.recording_id}, press {press.press}", fontsize=8)
        panel.set(xlabel="time since told, s", ylabel="force, N", ylim=(0, None))
    figure.axes[0].legend(frameon=False, fontsize=8, loc="lower center")
    return figure


def _draw_press(panel: Any, observed: Followed, static: Followed) -> None:
    trace = observed.press.trace
    clock = trace.time_s - trace.time_s[trace.told]
    shown = clock > -0.6
    panel.plot(clock[shown], trace.force_n[shown], color="#222222", lw=1.6, label="load cell")
    panel.plot([0], [observed.told_n], "o", color="#222222", ms=5, label="told")
    panel.fill_between(
        observed.time_s, observed.low_n, observed.high_n, color="#0072B2", alpha=0.2, lw=0
    )
    panel.plot(observed.time_s, observed.value_n, color="#0072B2", lw=1.3, label="observer")
    panel.plot(static.time_s, static.value_n, color="#D55E00", lw=1.1, ls="--", label="static")
