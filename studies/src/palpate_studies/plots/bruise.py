"""Figures of bruises: the paper's Figure 17b, ROC curves, reliability, what size is found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.plots.style import (
    AMBER,
    BLUE,
    GREEN,
    GREY,
    INK,
    ORANGE,
    PURPLE,
    legend_below,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = (GREY, AMBER, PURPLE, ORANGE, BLUE)


def draw_before_and_after(
    levels: Mapping[str, tuple[FloatArray, Mapping[str, FloatArray]]],
    *,
    published: Mapping[str, tuple[float, float]],
) -> Figure:
    """Draw mean and standard deviation over grasps against time (paper, Figure 17b).

    Parameters
    ----------
    levels : mapping
        Level -> times, and column of Table 6 -> changes in percent, shape (grasps, times).
    published : mapping of str to (float, float)
        Column -> published mean and standard deviation after 20 s.
    """
    with new_figure(columns=len(levels), width_in=7.2, height_in=3.6) as (figure, axes):
        for axis, (level, (time_s, columns)) in zip(axes[0], levels.items(), strict=True):
            for (name, traces), colour in zip(columns.items(), (BLUE, ORANGE, GREEN), strict=True):
                mean, sd = traces.mean(axis=0), traces.std(axis=0, ddof=1)
                axis.fill_between(time_s, mean - sd, mean + sd, color=colour, alpha=0.2, lw=0)
                axis.plot(time_s, mean, "--", color=colour, label=name)
                axis.errorbar(
                    21.0,
                    published[name][0],
                    published[name][1],
                    fmt="o",
                    color=colour,
                    capsize=3,
                    label=f"{name}, published at 20 s",
                )
            axis.set(
                xlabel="time from actuation (s)",
                title=f"Figure 17b, simulated, level {level}",
                xlim=(0, 22),
                xticks=range(0, 21, 5),
            )
        axes[0, 0].set_ylabel("mean relative change (%)")
        legend_below(figure, axes, entry_in=2.3)
        top = max(axis.get_ylim()[1] for axis in axes[0])
        for axis in axes[0]:
            low = axis.get_ylim()[0]
            axis.set_ylim(low, min(top, 15.0))
    return figure


def draw_roc(
    levels: Mapping[str, Mapping[str, tuple[NDArray[np.bool_], FloatArray]]],
) -> Figure:
    """Draw ROC curves: level -> label -> truth and score of each side."""
    with new_figure(columns=len(levels), width_in=7.2, height_in=5.2) as (figure, axes):
        for axis, (level, ways) in zip(axes[0], levels.items(), strict=True):
            axis.plot([0, 1], [0, 1], color=INK, lw=0.8, ls=":")
            for (label, (truth, score)), colour in zip(ways.items(), _COLOURS, strict=False):
                order = np.argsort(-score)
                hits = np.concatenate([[0.0], np.cumsum(truth[order]) / truth.sum()])
                alarms = np.concatenate([[0.0], np.cumsum(~truth[order]) / (~truth).sum()])
                axis.plot(alarms, hits, color=colour, label=label)
            axis.set(
                xlabel="share of sound sides called bruised",
                title=f"simulated, level {level}",
                aspect="equal",
            )
        axes[0, 0].set_ylabel("share of bruised sides found")
        legend_below(figure, axes, entry_in=3.4)
    return figure


def draw_reliability(levels: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]) -> Figure:
    """Draw the share of bruised sides against the stated probability, with its frequency.

    Parameters
    ----------
    levels : mapping
        Level -> label -> bins with `said`, `bruised`, `low`, `high` and `sides`.
    """
    with new_figure(columns=len(levels), width_in=7.2, height_in=4.0) as (figure, axes):
        for axis, (level, ways) in zip(axes[0], levels.items(), strict=True):
            axis.plot([0, 1], [0, 1], color=INK, lw=0.8, ls=":")
            for (label, bins), colour in zip(ways.items(), (ORANGE, BLUE), strict=False):
                stated, seen = ([one[key] for one in bins] for key in ("said", "bruised"))
                spans = [
                    [one["bruised"] - one["low"] for one in bins],
                    [one["high"] - one["bruised"] for one in bins],
                ]
                axis.errorbar(
                    stated, seen, spans, fmt="o-", color=colour, ms=4, lw=1, capsize=2, label=label
                )
            axis.set(
                xlabel="stated probability",
                title=f"simulated, level {level}",
                xlim=(-0.02, 1.02),
                ylim=(-0.02, 1.02),
            )
        axes[0, 0].set_ylabel("share that was bruised (90 % interval)")
        legend_below(figure, axes, entry_in=2.3)
    return figure


def draw_sizes(levels: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]]) -> Figure:
    """Draw the share found against the bruise's diameter: level -> label -> rows by size."""
    with new_figure(columns=len(levels), width_in=7.2, height_in=3.6) as (figure, axes):
        for axis, (level, ways) in zip(axes[0], levels.items(), strict=True):
            looks = ((ORANGE, "s"), (BLUE, "o"))
            for (label, rows), (colour, marker) in zip(ways.items(), looks, strict=False):
                middle = [0.5 * (row["from_mm"] + row["to_mm"]) for row in rows]
                found = [row["found"] for row in rows]
                # The one below shows where both are the same, and none is cut by the axis.
                size = 7 if marker == "s" else 4
                axis.plot(
                    middle,
                    found,
                    "-",
                    marker=marker,
                    ms=size,
                    color=colour,
                    label=label,
                    clip_on=False,
                )
            axis.axvline(11.3, color=INK, lw=0.8, ls=":")
            axis.text(11.6, 1.02, "1 cm²", fontsize=8, va="bottom")
            axis.set(
                xlabel="diameter of the bruise (mm)",
                title=f"simulated, level {level}",
                ylim=(0, 1.1),
                xlim=(0, 32),
            )
        axes[0, 0].set_ylabel("share found at 5 % false alarms")
        legend_below(figure, axes, entry_in=2.3)
    return figure
