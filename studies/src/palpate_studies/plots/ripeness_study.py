"""Ripeness of many fruits: settled change over days, accuracy of each way, days to ripe."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

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

_COLOURS = (BLUE, AMBER, GREEN, PURPLE, GREY, ORANGE)
#: Longest wait drawn, days.
_LONGEST = 6.0


def figure16(days: Mapping[str, Sequence[tuple[float, float]]]) -> Figure:
    """Draw mean and sd of the settled change over days, one panel per condition."""
    with new_figure(
        columns=max(len(days), 1), width_in=max(3.2 * len(days), 6.4), height_in=2.8, shared=True
    ) as (
        figure,
        axes,
    ):
        for axis, (name, values), colour in zip(
            axes[0], days.items(), (BLUE, ORANGE, GREEN), strict=False
        ):
            mean, sd = np.array(values).T
            at = np.arange(1, mean.size + 1)
            axis.errorbar(at, mean, yerr=sd, fmt="o-", color=colour, capsize=3)
            axis.set(xlabel="day", xticks=at, title=f"{name}, simulated")
        axes[0][0].set_ylabel("settled change (%)")
    return figure


def study_figure(
    accuracy: Mapping[str, Mapping[str, float | None]], waits: Mapping[str, NDArray[np.float64]]
) -> Figure:
    """Draw how often each way is exact, and predicted against true days to ripe.

    Parameters
    ----------
    accuracy : mapping
        Condition -> way -> percent of fruit days, None if there are none.
    waits : mapping
        Condition -> true, predicted, low and high days, shape (n, 4).
    """
    with new_figure(columns=1 + len(waits), width_in=5.0 + 2.9 * len(waits), height_in=4.0) as (
        figure,
        axes,
    ):
        _draw_accuracy(axes[0][0], accuracy)
        # Of one condition the other panel has the name.
        if len(accuracy) > 1:
            legend_below(figure, axes, entry_in=2.3)
        for axis, (name, rows) in zip(axes[0][1:], waits.items(), strict=True):
            true, value, low, high = np.clip(rows, 0.0, _LONGEST).T
            axis.vlines(true, low, high, color=BLUE, alpha=0.25, lw=1)
            axis.plot(true, value, ".", color=BLUE, ms=4)
            axis.plot([0, _LONGEST], [0, _LONGEST], color=INK, lw=0.8)
            # No dot is cut by the frame.
            ends = (-0.02 * _LONGEST, 1.02 * _LONGEST)
            axis.set(title=f"simulated:\n{name}", xlim=ends, ylim=ends)
            axis.set_xlabel(f"true days to ripe ({_LONGEST:g}: or more)")
        if waits:
            axes[0][1].set_ylabel("predicted days to ripe, 90 % interval")
    return figure


def _draw_accuracy(axis: Any, accuracy: Mapping[str, Mapping[str, float | None]]) -> None:
    ways = list(next(iter(accuracy.values())))
    height = 0.8 / len(accuracy)
    for number, (condition, exact) in enumerate(accuracy.items()):
        at = np.arange(len(ways)) + (number - (len(accuracy) - 1) / 2) * height
        axis.barh(
            at,
            [exact[way] or 0.0 for way in ways],
            height,
            color=_COLOURS[number],
            label=condition,
        )
    axis.axvline(90, color=INK, lw=0.8, ls="--")
    axis.set(yticks=range(len(ways)), yticklabels=ways, xlim=(0, 100))
    axis.set(xlabel="exact stage (% of fruit days)\ndashed: aim", title="stage of four, simulated")
    axis.invert_yaxis()
    axis.grid(visible=False, axis="y")
