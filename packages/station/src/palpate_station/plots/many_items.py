"""Overview of a batch or a day: stiffness over size, softening, counts and times."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from datetime import date, datetime, timedelta, tzinfo
from typing import TYPE_CHECKING

import numpy as np

from palpate.grasp.result import Outcome
from palpate.plots.style import AMBER, BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, log_axis
from palpate_station.plots.inline_svg import page_figure
from palpate_station.plots.item_history import date_axis, local
from palpate_station.records import About, Grasp
from palpate_station.store.item_history import ItemHistory

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Styles of the most frequent kinds; the others are grey.
_COLOURS = (BLUE, ORANGE, GREEN, PURPLE, SKY, AMBER)
_MARKERS = "osD^vP"
#: Above this number points are rasterised, to keep the file small.
_MOST_VECTORS = 1500


def size_stiffness_figure(pages: Sequence[ItemHistory]) -> Figure | None:
    """Draw the latest stiffness of items over size, by kind; None without data."""
    points = [
        (kind_of(page), size.middle, stiffness.middle)
        for page in pages
        if (size := page.latest_value("size_mm"))
        and (stiffness := page.latest_value("stiffness_n_per_mm"))
    ]
    if not points:
        return None
    styles = _kind_styles(pages)
    with page_figure() as (figure, (axis,)):
        for kind, (colour, marker) in styles.items():
            chosen = np.array([(s, k) for name, s, k in points if name == kind]).reshape(-1, 2)
            axis.plot(
                chosen[:, 0],
                chosen[:, 1],
                marker,
                color=colour,
                ms=4.5 if len(points) < 200 else 2.5,
                alpha=0.85,
                mew=0,
                label="others" if colour == GREY else kind,
                rasterized=len(points) > _MOST_VECTORS,
            )
        log_axis(axis.yaxis)
        axis.set_xlabel("size (mm)")
        axis.set_ylabel("stiffness (N/mm)")
        if len(styles) > 1:
            # The grey kinds have a single entry.
            handles, labels = axis.get_legend_handles_labels()
            entries = dict(zip(labels, handles, strict=True))
            figure.legend(
                entries.values(),
                entries,
                loc="outside upper left",
                ncols=7,
                fontsize=8,
                columnspacing=1.0,
                handletextpad=0.2,
            )
    return figure


def softening_figure(pages: Sequence[ItemHistory], *, zone: tzinfo | None = None) -> Figure | None:
    """Draw the daily geometric mean stiffness; None if every item spans less than 12 h."""
    tracks = []
    for page in pages:
        days: dict[date, list[tuple[datetime, float]]] = {}
        for grasp in page.grasps:
            measured = grasp.measurements.get("stiffness_n_per_mm")
            if measured is not None and measured.value is not None:
                time = local(grasp.taken_at, zone)
                days.setdefault(time.date(), []).append((time, measured.value))
        track = [
            (day[0][0], math.prod(value for _, value in day) ** (1 / len(day)))
            for day in days.values()
        ]
        if track and track[-1][0] - track[0][0] >= timedelta(hours=12):
            tracks.append((kind_of(page), track))
    if not tracks:
        return None
    styles = _kind_styles(pages)
    with page_figure() as (figure, (axis,)):
        for kind, track in tracks:
            times, values = zip(*track, strict=True)
            colour, _ = styles[kind]
            axis.plot(
                times,
                values,
                "-o",
                color=colour,
                ms=2.5,
                lw=0.9,
                alpha=float(np.clip(6 / len(tracks), 0.08, 0.9)),
                rasterized=len(tracks) > _MOST_VECTORS,
            )
        log_axis(axis.yaxis)
        axis.set_ylabel("stiffness (N/mm)")
        date_axis(axis, [time for _, track in tracks for time, _ in track])
    return figure


def counts_figure(counts: Sequence[tuple[str, int]]) -> Figure:
    """Draw the number of each name as bars, in the given order."""
    names = [name if len(name) <= 24 else f"{name[:23]}…" for name, _ in counts]
    numbers = [number for _, number in counts]
    height_in = min(2.9, 0.7 + 0.36 * max(len(counts), 3))
    with page_figure(height_in=height_in) as (figure, (axis,)):
        bars = axis.barh(range(len(counts)), numbers, color=BLUE, height=0.62)
        axis.bar_label(bars, padding=3, color=INK, fontsize=9)
        axis.set_yticks(range(len(counts)), names)
        axis.set_xticks([])
        axis.grid(visible=False)
        axis.tick_params(axis="y", length=0)
        axis.spines[["bottom", "left"]].set_visible(False)
        axis.margins(x=0.12)
        # Limit the height of a single bar.
        axis.set_ylim(max(len(counts), 3) - 0.5, -0.5)
    return figure


def hours_figure(grasps: Sequence[Grasp], *, zone: tzinfo | None = None) -> Figure:
    """Draw the number of completed and of other grasps per hour."""
    held, other = [0] * 24, [0] * 24
    for grasp in grasps:
        counts = held if grasp.outcome is Outcome.HELD else other
        counts[local(grasp.taken_at, zone).hour] += 1
    used = [hour for hour in range(24) if held[hour] + other[hour]]
    first, last = max(0, used[0] - 1), min(23, used[-1] + 1)
    hours = range(first, last + 1)
    with page_figure() as (figure, (axis,)):
        axis.bar(hours, [held[h] for h in hours], color=BLUE, width=0.8, label="held")
        if any(other):
            axis.bar(
                hours,
                [other[h] for h in hours],
                bottom=[held[h] for h in hours],
                color=ORANGE,
                width=0.8,
                label="not held",
            )
            figure.legend(loc="outside upper left", ncols=2, fontsize=8)
        ticks = [h for h in hours if last - first < 12 or h % 3 == 0]
        axis.set_xticks(ticks, [f"{h:02d}:00" for h in ticks])
        axis.grid(visible=False, axis="x")
        axis.yaxis.get_major_locator().set_params(integer=True)
        axis.set_ylabel("grasps per hour")
        axis.set_ylim(0, 1.08 * max(a + b for a, b in zip(held, other, strict=True)))
    return figure


def kind_of(page: ItemHistory) -> str:
    """Return the kind stated by a person, or else the identified kind."""
    if page.item.kind is not None:
        return page.item.kind
    verdict = page.latest_verdict(About.IDENTITY)
    return "not named" if verdict is None else verdict.text


def _kind_styles(pages: Sequence[ItemHistory]) -> dict[str, tuple[str, str]]:
    """Return the colour and marker of each kind, the most frequent first."""
    kinds = [kind for kind, _ in Counter(map(kind_of, pages)).most_common()]
    styles = list(zip(_COLOURS, _MARKERS, strict=True))
    return {kind: styles[k] if k < len(styles) else (GREY, ".") for k, kind in enumerate(kinds)}
