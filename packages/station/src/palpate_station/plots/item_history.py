"""Figures of one item: measurements over time, and pixel readings of each side."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.measurement import Status
from palpate.plots.pixel_colors import DEEPEST_PERCENT, change_colormap, is_dark
from palpate.plots.style import BLUE, GREY, INK, ORANGE, plain_number
from palpate_station.plots.inline_svg import page_figure
from palpate_station.records import About, Grasp, Source, Verdict
from palpate_station.store.item_history import ItemHistory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Maximum number of sides with pixels in the figure; the last grasp of each is shown.
_MOST_SIDES = 4
#: Text colours on pixels, independent of the page's theme, as are the pixel colours.
_ON_DARK, _ON_LIGHT = "#FDFDFD", "#101010"


def history_figure(
    page: ItemHistory, name: str, *, label: str, zone: tzinfo | None = None
) -> Figure:
    """Draw one measurement of an item over time, with intervals and people's ripeness labels.

    Parameters
    ----------
    page : ItemHistory
        The item.
    name : str
        Name of the measurement.
    label : str
        Label of the axis, with unit.
    zone : tzinfo, optional
        Time zone of the axis; the system's by default.
    """
    measured = [
        (grasp.taken_at, found)
        for grasp in page.grasps
        if (found := grasp.measurements.get(name)) is not None and found.value is not None
    ]
    with page_figure() as (figure, (axis,)):
        times = [local(time, zone) for time, _ in measured]
        value, low, high = (
            np.array([getattr(m, end) for _, m in measured]) for end in ("value", "low", "high")
        )
        is_ok = np.array([m.status is Status.OK for _, m in measured], dtype=bool)
        axis.plot(times, value, color=BLUE, lw=1, alpha=0.45)
        for mask, filled in ((is_ok, BLUE), (~is_ok, "none")):
            if mask.any():
                axis.errorbar(
                    np.array(times)[mask],
                    value[mask],
                    yerr=np.clip([(value - low)[mask], (high - value)[mask]], 0, None),
                    fmt="o",
                    color=BLUE,
                    mfc=filled,
                    elinewidth=1.2,
                    capsize=2.5,
                )
        axis.set_ylabel(label)
        if name == "stiffness_n_per_mm":
            _limit_axis(axis, value, high)
        _draw_labels(axis, page, zone)
        # The same axis for all measurements of an item.
        labelled = [verdict.given_at for verdict in _labels(page)]
        shown = [*(grasp.taken_at for grasp in page.grasps), *labelled]
        date_axis(axis, [local(time, zone) for time in shown])
    return figure


def pixels_figure(grasps: Sequence[Grasp]) -> Figure | None:
    """Draw the pixel readings of the last grasp of each side; None without pixels."""
    sides = {g.angle_deg: g for g in grasps if g.pixel_settled_percent is not None}
    shown = list(sides.items())[-_MOST_SIDES:]
    if not shown:
        return None
    maps = [np.array(g.pixel_settled_percent, dtype=float) for _, g in shown]
    with page_figure(columns=len(shown), height_in=2.6) as (figure, axes):
        for axis, (angle, _), pixels in zip(axes, shown, maps, strict=True):
            _draw_pixels(axis, pixels)
            axis.set_title("last grasp" if angle is None else f"{angle:g}°", color=INK)
    return figure


def local(moment: datetime, zone: tzinfo | None) -> datetime:
    """Return the local time in a zone, without time zone information, for plots."""
    return moment.astimezone(zone).replace(tzinfo=None)


def date_axis(axis: Any, times: Sequence[datetime]) -> None:
    """Label a time axis briefly, and limit it to the times with a margin."""
    from matplotlib import dates

    # The classes have no type annotations.
    untyped: Any = dates
    locator = untyped.AutoDateLocator(minticks=3, maxticks=7)
    axis.xaxis.set_major_locator(locator)
    formats = ["%Y", "%b", "%d", "%H:%M", "%H:%M", "%H:%M:%S"]
    zeros = ["", "%Y", "%b", "%b-%d", "%H:%M", "%H:%M"]
    formatter = untyped.ConciseDateFormatter(locator, formats=formats, zero_formats=zeros)
    axis.xaxis.set_major_formatter(formatter)
    first, last = min(times), max(times)
    margin = timedelta(hours=1) if first == last else 0.06 * (last - first)
    axis.set_xlim(first - margin, last + margin)


def _limit_axis(axis: Any, value: np.ndarray, high: np.ndarray) -> None:
    """Start the axis at 0 and ignore single wide intervals in the upper limit."""
    typical = float(np.median(high) + 3 * np.ptp(value))
    axis.set_ylim(0, min(float(high.max()) * 1.08, max(typical, float(value.max()) * 1.15)))


def _labels(page: ItemHistory) -> list[Verdict]:
    """Return the ripeness labels given by people."""
    return [
        verdict
        for verdict in page.verdicts
        if verdict.about is About.RIPENESS and verdict.source is Source.PERSON
    ]


def _draw_labels(axis: Any, page: ItemHistory, zone: tzinfo | None) -> None:
    for verdict in _labels(page):
        time = local(verdict.given_at, zone)
        axis.axvline(time, color=ORANGE, lw=1, ls=":")
        axis.annotate(
            verdict.text,
            (time, 1),
            xycoords=("data", "axes fraction"),
            xytext=(3, -2),
            textcoords="offset points",
            va="top",
            color=ORANGE,
            fontsize=8,
        )


def _draw_pixels(axis: Any, pixels: np.ndarray) -> None:
    rows, columns = pixels.shape
    axis.pcolormesh(
        np.arange(columns + 1),
        np.arange(rows + 1),
        pixels,
        cmap=change_colormap(),
        vmin=-DEEPEST_PERCENT,
        vmax=DEEPEST_PERCENT,
        edgecolors=GREY,
        lw=0.5,
    )
    for row in range(rows):
        for column in range(columns):
            percent = pixels[row, column]
            is_read = bool(np.isfinite(percent))
            axis.text(
                column + 0.5,
                row + 0.5,
                plain_number(round(float(percent))) if is_read else "–",
                ha="center",
                va="center",
                fontsize=8,
                color=_ON_DARK if is_read and is_dark(float(percent)) else _ON_LIGHT,
            )
    axis.invert_yaxis()
    axis.set_xticks([])
    axis.set_yticks([])
    axis.grid(visible=False)
    axis.set_aspect("equal")
    for spine in axis.spines.values():
        spine.set_visible(False)
