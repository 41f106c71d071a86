"""Figure of newtons: over time with their interval and the known load, or over the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.calibrate.recorded_force import ForceTrace
from palpate.plots.style import BLUE, INK, ORANGE, legend_below, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Most recordings or sensors in one figure.
_MOST_PANELS = 6
_HEIGHT_IN = 2.1


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnForce:
    """The newtons of a sensor; `is_settled`: of settled readings, and not over time."""

    title: str
    traces: Sequence[ForceTrace]
    is_settled: bool


def force_trace_figure(sensors: Sequence[DrawnForce]) -> Figure:
    """Draw the first recordings, or the first sensors of settled readings.

    Raises `MissingExtraError` if matplotlib isn't installed.
    """
    panels = [
        (one.title if one.is_settled else trace.name, trace, one.is_settled)
        for one in sensors
        for trace in one.traces
    ][:_MOST_PANELS]
    height_in = 0.6 + _HEIGHT_IN * len(panels)
    with new_figure(rows=len(panels), width_in=6.4, height_in=height_in) as (figure, axes):
        for axis, (title, trace, is_settled) in zip(axes[:, 0], panels, strict=True):
            if is_settled:
                _draw_settled(axis, trace)
            else:
                _draw_over_time(axis, trace)
            axis.set_title(title)
        legend_below(figure, axes)
        return figure


def _draw_settled(axis: Any, trace: ForceTrace) -> None:
    known = np.isfinite(trace.load_n) & np.isfinite(trace.force_n)
    load, force = trace.load_n[known], trace.force_n[known]
    below, above = force - trace.low_n[known], trace.high_n[known] - force
    axis.errorbar(
        load, force, yerr=[below, above], fmt="o", color=BLUE, label="palpate, 90 % interval"
    )
    most = float(max(load.max(initial=1.0), force.max(initial=1.0)))
    axis.plot([0, most], [0, most], color=INK, lw=0.8, label="known load")
    axis.set(xlabel="known load (N)", ylabel="force (N)")


def _draw_over_time(axis: Any, trace: ForceTrace) -> None:
    high = np.where(np.isfinite(trace.high_n), trace.high_n, np.nan)
    axis.fill_between(
        trace.time_s, trace.low_n, high, color=BLUE, alpha=0.25, lw=0, label="90 % interval"
    )
    axis.plot(trace.time_s, trace.force_n, color=BLUE, label="palpate")
    if np.isfinite(trace.load_n).any():
        axis.plot(trace.time_s, trace.load_n, color=ORANGE, lw=1.0, label="known load")
    axis.set(xlabel="time (s)", ylabel="force (N)")
