"""Cost of purer bins: purity against items sorted per hour, and the share left for people."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from palpate.plots.style import BLUE, GREY, ORANGE, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def purity_figure(summary: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw for each way of sorting what went right, wrong, and to be sorted by hand.

    Parameters
    ----------
    summary : sequence of mapping
        Entries with `level`, `method`, `purity`, `left_over` and `items_per_hour`.
    """
    levels = list(dict.fromkeys(entry["level"] for entry in summary))
    ways = len({entry["method"] for entry in summary})
    with new_figure(
        columns=len(levels), width_in=5.2 * len(levels), height_in=1.2 + 0.26 * ways
    ) as (figure, axes):
        for axis, level in zip(axes[0], levels, strict=True):
            mine = [entry for entry in summary if entry["level"] == level][::-1]
            placed = [100 * (1 - entry["left_over"]) for entry in mine]
            right = [
                share * (entry["purity"] or 0.0) for share, entry in zip(placed, mine, strict=True)
            ]
            wrong = [share - good for share, good in zip(placed, right, strict=True)]
            left = [100 - share for share in placed]
            at = range(len(mine))
            axis.barh(at, right, color=BLUE, label="right bin")
            axis.barh(at, wrong, left=right, color=ORANGE, label="wrong bin")
            axis.barh(at, left, left=placed, color=GREY, alpha=0.45, label="left for hand")
            for place, entry in zip(at, mine, strict=True):
                axis.text(102, place, f"{entry['items_per_hour']:.0f}", va="center")
            axis.text(102, len(mine) - 0.4, "items/h", va="bottom", fontsize=7)
            # The ways are the same at every level: named once, they leave the bars their room.
            names = [entry["method"] for entry in mine]
            axis.set_yticks(at, names if axis is axes[0][0] else [])
            axis.set(xlim=(0, 100), xlabel="share of the crate (%)")
            axis.set_title(f"simulated, level {level}")
            axis.grid(visible=False, axis="y")
        handles, labels = axes[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=3)
    return figure
