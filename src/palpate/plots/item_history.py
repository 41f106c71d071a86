"""One item over its grasps: its measurements, and the pixel readings on each side."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timedelta, tzinfo
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.plots.inline_svg import page_figure
from palpate.plots.pixel_colors import DEEPEST_PERCENT, change_colormap, is_dark
from palpate.plots.style import BLUE, GREY, INK, ORANGE, plain_number
from palpate.produce.records import About, Grasp, Source
from palpate.produce.store.item_history import ItemHistory
from palpate.settling.result import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Number of sides whose pixels are shown: the last grasp of each.
_MOST_SIDES = 4
#: Not colours of the page: what lies under them does not change by night.
_ON_DARK, _ON_LIGHT = "#FDFDFD", "#101010"


def history_figure(
    page: ItemHistory, name: str, *, label: str, zone: tzinfo | None = None
) -> Figure:
    """Draw one measurement of an item over time, with its intervals and people's verdicts.

    Parameters
    ----------
    page : ItemHistory
        The item.
    name : str
        Name of the measurement.
    label : str
        Of the axis, with its unit.
    zone : tzinfo, optional
        Time zone of the axis; this machine's by default.
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
        sure = np.array([m.status is Status.OK for _, m in measured], dtype=bool)
        axis.plot(times, value, color=BLUE, lw=1, alpha=0.45)
        for mask, marker, filled in ((sure, "o", BLUE), (~sure, "o", "none")):
            if mask.any():
                axis.errorbar(
                    np.array(times)[mask],
                    value[mask],
                    yerr=np.clip([(value - low)[mask], (high - value)[mask]], 0, None),
                    fmt=marker,
                    color=BLUE,
                    mfc=filled,
                    elinewidth=1.2,
                    capsize=2.5,
                )
        axis.set_ylabel(label)
        if name == "stiffness_n_per_mm":
            _from_zero(axis, value, high)
        _mark_words(axis, page, zone)
        date_axis(axis, times)
    return figure


def pixels_figure(grasps: Sequence[Grasp]) -> Figure | None:
    """Draw the pixel readings at the answer, last grasp of each side; None without pixels."""
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
    """Return the time on the wall of a zone, as plots take it."""
    return moment.astimezone(zone).replace(tzinfo=None)


def date_axis(axis: Any, times: Sequence[datetime]) -> None:
    """Label a time axis briefly; one moment alone gets room around it."""
    from matplotlib import dates

    # Its classes carry no types.
    untyped: Any = dates
    locator = untyped.AutoDateLocator(minticks=3, maxticks=7)
    axis.xaxis.set_major_locator(locator)
    axis.xaxis.set_major_formatter(untyped.ConciseDateFormatter(locator))
    axis.margins(x=0.06)
    if len(set(times)) == 1:
        axis.set_xlim(times[0] - timedelta(hours=1), times[0] + timedelta(hours=1))


def _from_zero(axis: Any, value: np.ndarray, high: np.ndarray) -> None:
    """Begin at 0, and let no single wide interval press all the others flat."""
    usual = float(np.median(high) + 3 * np.ptp(value))
    axis.set_ylim(0, min(float(high.max()) * 1.08, max(usual, float(value.max()) * 1.15)))


def _mark_words(axis: Any, page: ItemHistory, zone: tzinfo | None) -> None:
    for verdict in page.verdicts:
        if verdict.about is About.RIPENESS and verdict.source is Source.PERSON:
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
            read = pixels[row, column]
            reads = bool(np.isfinite(read))
            axis.text(
                column + 0.5,
                row + 0.5,
                plain_number(round(float(read))) if reads else "–",
                ha="center",
                va="center",
                fontsize=8,
                color=_ON_DARK if reads and is_dark(float(read)) else _ON_LIGHT,
            )
    axis.invert_yaxis()
    axis.set_xticks([])
    axis.set_yticks([])
    axis.grid(visible=False)
    axis.set_aspect("equal")
    for spine in axis.spines.values():
        spine.set_visible(False)
