"""Kinds of a mixed crate: where they lie, what they are taken for, how far to trust that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from palpate.plots.style import BLUE, GREY, INK, log_axis, look_of, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: One marker and colour for each kind, in the order met; strangers are grey crosses.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#222222")
_MARKERS = "os^DvP*Xph"


def confusion_figure(
    by_level: Mapping[str, tuple[Sequence[str], Sequence[str], NDArray[Any]]],
) -> Figure:
    """Draw true against named kinds, one panel per level; shades are shares of a row.

    Parameters
    ----------
    by_level : mapping of str to (true kinds, named kinds, counts)
        Counts of shape (true kinds, named kinds).
    """
    with new_figure(columns=len(by_level), width_in=5.2 * len(by_level), height_in=3.8) as (
        figure,
        axes,
    ):
        for axis, (level, (true, named, counts)) in zip(axes[0], by_level.items(), strict=True):
            share = counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
            axis.imshow(share, cmap="Blues", vmin=0, vmax=1)
            axis.set_xticks(range(len(named)), named, rotation=45, ha="right")
            axis.set_yticks(range(len(true)), true)
            axis.grid(visible=False)
            for (row, column), count in np.ndenumerate(counts):
                if count:
                    colour = "white" if share[row, column] > 0.5 else INK
                    axis.text(column, row, str(count), ha="center", va="center", color=colour)
            axis.set_xlabel("named")
            axis.set_title(f"simulated, level {level}")
        axes[0][0].set_ylabel("truly")
    return figure


def kinds_figure(by_level: Mapping[str, Sequence[tuple[str, bool, float, float]]]) -> Figure:
    """Draw measured stiffness against measured size, one panel per level.

    Parameters
    ----------
    by_level : mapping of str to sequence of (kind, taught, size_mm, stiffness_n_per_mm)
        One grasp each.
    """
    with new_figure(
        columns=len(by_level), width_in=5.4 * len(by_level), height_in=4.6, shared=True
    ) as (figure, axes):
        for axis, (level, points) in zip(axes[0], by_level.items(), strict=True):
            kinds = list(dict.fromkeys(kind for kind, taught, *_ in points if taught))
            for number, kind in enumerate(kinds):
                sizes, stiffness = _columns(points, kind)
                axis.plot(
                    sizes,
                    stiffness,
                    ls="",
                    marker=_MARKERS[number % len(_MARKERS)],
                    color=_COLOURS[number % len(_COLOURS)],
                    mfc="none" if number >= len(_COLOURS) else None,
                    label=kind,
                )
            strangers = [(size, k) for _, taught, size, k in points if not taught]
            if strangers:
                axis.plot(*zip(*strangers, strict=True), "x", color=GREY, label="strangers")
            axis.set_xlabel("size measured (mm)")
            log_axis(axis.yaxis)
            axis.set_title(f"simulated, level {level}: first grasp of each item")
        axes[0][0].set_ylabel("stiffness measured (N/mm)")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=5)
    return figure


def _columns(
    points: Sequence[tuple[str, bool, float, float]], kind: str
) -> tuple[list[float], list[float]]:
    mine = [(size, stiffness) for one, _, size, stiffness in points if one == kind]
    return [size for size, _ in mine], [stiffness for _, stiffness in mine]


def reliability_figure(by_level: Mapping[str, Sequence[Mapping[str, Any]]]) -> Figure:
    """Draw how often the best guess was right against the probability stated for it.

    Parameters
    ----------
    by_level : mapping of str to sequence of mapping
        Entries with `stated`, `right` and `items`.
    """
    with new_figure(width_in=4.6, height_in=4.2) as (figure, axes):
        axis = axes[0][0]
        axis.plot([0, 1], [0, 1], "--", color=GREY, lw=1, label="as stated")
        for (level, entries), colour in zip(
            by_level.items(), (BLUE, look_of("exponential")[0]), strict=False
        ):
            stated, right, items = (
                np.array([entry[name] for entry in entries])
                for name in ("stated", "right", "items")
            )
            spread = 1.645 * np.sqrt(np.maximum(right * (1 - right), 0.25 / items) / items)
            # No share is below none, or above all.
            ends = np.minimum(spread, [right, 1 - right])
            axis.errorbar(
                stated, right, yerr=ends, marker="o", capsize=2, color=colour, label=level
            )
        axis.set(xlabel="probability stated", ylabel="share that was right", ylim=(0, 1.05))
        axis.set_title("simulated; bars: 90 % of what chance does")
        axis.legend(loc="upper left")
    return figure
