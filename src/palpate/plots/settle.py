"""What a prediction of the settled value looks like: curve, window, forecast, band, settled."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.holds import Hold
from palpate.plots.style import GREY, INK, legend_below, look_of, new_figure
from palpate.settling.result import SettlingMethod
from palpate.settling.scoring import settled_value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Instants between the cut-off and the horizon at which the forecast is drawn.
FORECAST_POINTS = 15

#: The forecast is drawn from this long after the cut-off: nearer, there is nothing to predict.
SOONEST_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One hold to draw, and why it was chosen.

    Attributes
    ----------
    title : str
        Stands above the panel.
    hold : Hold
        Its samples up to the horizon at least.
    cutoff_s : float
        Forecasts rest on samples up to here.
    """

    title: str
    hold: Hold
    cutoff_s: float


def settle_figure(
    panels: Sequence[Panel],
    *,
    methods: Mapping[str, SettlingMethod],
    horizon_s: float,
    level: float,
) -> Figure:
    """Draw a few holds with the forecast of every method; the first method also gets its band."""
    columns = min(3, len(panels))
    rows = -(-len(panels) // columns)
    with new_figure(
        rows=rows, columns=columns, width_in=0.8 + 3.4 * columns, height_in=0.8 + 2.6 * rows
    ) as (figure, axes):
        for axis, panel in zip(axes.flat, panels, strict=False):
            _draw_panel(axis, panel, methods=methods, horizon_s=horizon_s, level=level)
        for axis in axes.flat[len(panels) :]:
            axis.set_visible(False)
        for axis in axes[:, 0]:
            axis.set_ylabel("value (unit of the file)")
        for axis in axes.flat[max(0, len(panels) - columns) : len(panels)]:
            axis.set_xlabel("time (s)")
        legend_below(figure, axes)
    return figure


def _draw_panel(
    axis: Any,
    panel: Panel,
    *,
    methods: Mapping[str, SettlingMethod],
    horizon_s: float,
    level: float,
) -> None:
    hold, cutoff_s = panel.hold, panel.cutoff_s
    seen = hold.time_s <= cutoff_s
    shown = hold.time_s <= horizon_s
    axis.axvspan(hold.time_s[0], cutoff_s, color="#F0F0F0", zorder=0, label="window used")
    axis.plot(hold.time_s[shown & ~seen], hold.values[shown & ~seen], ".", color="#BBBBBB", ms=2.5)
    axis.plot(hold.time_s[seen], hold.values[seen], ".", color=INK, ms=3.5, label="samples")
    settled = settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
    if np.isfinite(settled):
        axis.axhline(settled, color=GREY, ls="--", lw=1, label="settled value")
    if seen.any():
        first_s = min(cutoff_s + SOONEST_S, horizon_s)
        times_s = np.geomspace(first_s, horizon_s, FORECAST_POINTS)
        for rank, (name, method) in enumerate(methods.items()):
            forecast = [
                method.predict(
                    hold.time_s[seen], hold.values[seen][None, :], horizon_s=until_s, level=level
                ).hold(0)
                for until_s in times_s
            ]
            _draw_forecast(axis, times_s, forecast, name=name, band=rank == 0, level=level)
    axis.set_title(panel.title, loc="left")
    axis.set_xlim(min(0.0, float(hold.time_s[0])), horizon_s * 1.03)


def _draw_forecast(
    axis: Any, times_s: Any, forecast: Sequence[Any], *, name: str, band: bool, level: float
) -> None:
    colour, marker = look_of(name)
    value, low, high = (
        np.array([getattr(estimate, end) for estimate in forecast])
        for end in ("value", "low", "high")
    )
    axis.plot(times_s, value, color=colour, label=name)
    axis.plot(times_s[-1:], value[-1:], marker, color=colour)
    if band and np.isfinite(low).all():
        axis.fill_between(
            times_s, low, high, color=colour, alpha=0.18, lw=0, label=f"{level:.0%} band of {name}"
        )
