"""Firmness of the grip against the rate of rupture, one panel per fruit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from palpate.plots.style import legend_below, look_of, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Line of each policy: the method whose colour it takes, and the dashes.
LOOKS = {
    "ours": ("relaxation", "-"),
    "ours, fruit unknown": ("relaxation", "--"),
    "cap per fruit": ("recorded", "-"),
    "stiffness rule": ("exponential", "-"),
    "rule as published": ("exponential", ":"),
}


def tradeoff_figure(entries: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw the trade-off.

    Parameters
    ----------
    entries : sequence of mapping
        As `palpate_studies.rupture_tradeoff.tradeoff` returns them.
    """
    fruits = list(dict.fromkeys(entry["fruit"] for entry in entries))
    with new_figure(columns=len(fruits), width_in=2.6 * len(fruits), height_in=3.4) as (fig, axes):
        for axis, fruit in zip(axes[0], fruits, strict=True):
            for method, (look, line) in LOOKS.items():
                chosen = [e for e in entries if (e["fruit"], e["method"]) == (fruit, method)]
                if not chosen:
                    continue
                color, marker = look_of(look)
                axis.plot(
                    [100 * entry["rupture_rate"] for entry in chosen],
                    [entry["firmness"] for entry in chosen],
                    line,
                    color=color,
                    marker=marker,
                    label=method,
                )
            count = next(entry["grasps"] for entry in entries if entry["fruit"] == fruit)
            axis.set_title(f"{fruit} ({count} grasps)")
            axis.set_xlabel("ruptured (%)")
            axis.set_ylim(0, 1)
        axes[0][0].set_ylabel("stop force / rupture force")
        legend_below(fig, axes, entry_in=1.4)
        fig.suptitle("Real fruit: firmness of the grip, settings chosen on other fruit")
    return fig
