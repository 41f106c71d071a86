"""Figure of predicted settled values: curve, window, forecast, band, settled value."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.holds import Hold, measure_settled_value
from palpate.holds.cutting import CutColumn
from palpate.plots.style import GREY, INK, legend_below, log_axis, method_style, new_figure
from palpate.settling.result import SettlingMethod

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Number of points of a forecast between the cut-off and the horizon.
FORECAST_POINTS = 15

#: Maximum number of overviews, approximate number of points of each, and the ratio of the values
#: above which an axis is logarithmic.
MOST_OVERVIEWS, OVERVIEW_POINTS, LOGARITHMIC_FROM = 3, 20_000, 10.0

#: Labels of the value axis, by unit.
VALUE_LABELS = {
    None: "value (unit of the file)",
    "ohm": "resistance (ohm)",
    "percent": "relative change (%)",
    "counts": "reading (counts)",
    "volt": "voltage (V)",
}

#: Width of a letter of a title, and width of a column's axis labels, inches.
_LETTER_IN, _AXIS_IN = 0.056, 0.65

#: Start of the forecast after the cut-off, seconds.
SOONEST_S = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Panel:
    """One hold to draw.

    Attributes
    ----------
    title : str
        Title of the panel.
    hold : Hold
        Hold to draw, up to the horizon.
    cutoff_s : float
        Time of the last sample that forecasts may use.
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
    overviews: Sequence[tuple[str, CutColumn]] = (),
) -> Figure:
    """Draw holds with the forecast of each method, and the band of the first method.

    `overviews`: titles and recordings of the holds, drawn above the panels.
    """
    above = len(overviews)
    columns = max(min(3, len(panels)), 2 if above else 1)
    rows = above + math.ceil(len(panels) / columns)
    with new_figure(
        rows=rows, columns=columns, width_in=0.8 + 3.4 * columns, height_in=0.8 + 2.6 * rows
    ) as (figure, grid):
        for row, (title, recording) in zip(grid, overviews, strict=False):
            _draw_overview(figure, row, title, recording)
        axes = grid[above:]
        letters = int((figure.get_figwidth() / columns - _AXIS_IN) / _LETTER_IN)
        for axis, panel in zip(axes.flat, panels, strict=False):
            _draw_panel(axis, panel, methods=methods, horizon_s=horizon_s, level=level)
            axis.set_title(_fold_title(panel.title, letters), loc="left")
        for axis in axes.flat[len(panels) :]:
            axis.set_visible(False)
        one_unit = len({panel.hold.unit for panel in panels}) == 1
        for place, (axis, panel) in enumerate(zip(axes.flat, panels, strict=False)):
            if place % columns == 0 or not one_unit:
                axis.set_ylabel(_value_label(panel.hold.unit))
        for axis in axes.flat[max(0, len(panels) - columns) : len(panels)]:
            axis.set_xlabel("time (s)")
        legend_below(figure, axes, entry_in=1.4)
    return figure


def _fold_title(title: str, letters: int) -> str:
    """Wrap the lines of a title to a maximum number of letters.

    >>> _fold_title("a-hold\\nerror +2 % of settled, 30 % of the rest", 30).splitlines()
    ['a-hold', 'error +2 % of settled, 30 % of', 'the rest']
    """
    return "\n".join(textwrap.fill(line, letters) for line in title.splitlines())


def _value_label(unit: str | None) -> str:
    return VALUE_LABELS.get(unit, f"value ({unit})")


def _draw_overview(figure: Figure, row: Any, title: str, recording: CutColumn) -> None:
    """Draw a recording across a row of the grid, with its holds shaded and numbered."""
    for axis in row:
        axis.remove()
    axis = figure.add_subplot(row[0].get_gridspec()[row[0].get_subplotspec().rowspan.start, :])
    thinned = slice(None, None, max(1, recording.time_s.size // OVERVIEW_POINTS))
    axis.plot(recording.time_s[thinned], recording.values[thinned], color=INK, lw=0.7)
    low, high = float(np.nanmin(recording.values)), float(np.nanmax(recording.values))
    if low > 0 and high > LOGARITHMIC_FROM * low:
        log_axis(axis.yaxis)
    for number, (begin_s, end_s) in enumerate(recording.spans, start=1):
        axis.axvspan(begin_s, end_s, color="#0072B2", alpha=0.2, lw=0)
        axis.annotate(str(number), (begin_s, 0.97), xycoords=("data", "axes fraction"), va="top")
    axis.set_title(title, loc="left")
    axis.set_xlabel("time of the recording (s)")
    axis.set_ylabel(_value_label(recording.unit))


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
    settled = measure_settled_value(hold.time_s, hold.values, horizon_s=horizon_s)
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
    axis.set_xlim(min(0.0, float(hold.time_s[0])), horizon_s * 1.03)


def _draw_forecast(
    axis: Any, times_s: Any, forecast: Sequence[Any], *, name: str, band: bool, level: float
) -> None:
    colour, marker = method_style(name)
    value, low, high = (
        np.array([getattr(estimate, end) for estimate in forecast])
        for end in ("value", "low", "high")
    )
    axis.plot(times_s, value, marker, ls="-", markevery=[-1], color=colour, label=name)
    if band and np.isfinite(low).all():
        axis.fill_between(
            times_s,
            low,
            high,
            color=colour,
            alpha=0.18,
            lw=0,
            label=f"{100 * level:.0f} % band of {name}",
        )
