"""Force of hybrid grasps: what was reported, and how close it came to rupture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from palpate.estimate.measurement import Measurement
from palpate.plots.style import BLUE, GREEN, GREY, ORANGE, legend_below, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = (BLUE, GREEN, ORANGE)
#: Where the axes are marked.
FORCES_N = (0.3, 0.5, 1, 2, 3, 5, 10, 20, 30)


class Gripped(Protocol):
    """The part of a grasp that is drawn."""

    @property
    def fruit(self) -> str:
        """The kind of fruit."""
        ...

    @property
    def force_n(self) -> float:
        """True force of the final grip."""
        ...

    @property
    def rupture_n(self) -> float:
        """Force of rupture."""
        ...

    @property
    def said(self) -> Measurement | None:
        """The force that the grasp reported."""
        ...


def hybrid_figure(found: Sequence[Gripped]) -> Figure:
    """Draw reported against true force, and true force against the force of rupture."""
    from matplotlib.ticker import FixedLocator, NullLocator

    with new_figure(columns=2, width_in=8.4, height_in=4.0) as (figure, axes):
        force_axis, limit_axis = axes[0]
        for fruit, colour in zip(dict.fromkeys(o.fruit for o in found), COLOURS, strict=False):
            mine = [one for one in found if one.fruit == fruit]
            answered = [(one.force_n, one.said) for one in mine if one.said is not None]
            ends = [(max(m.middle - m.low, 0.0), max(m.high - m.middle, 0.0)) for _, m in answered]
            force_axis.errorbar(
                [force for force, _ in answered],
                [m.value for _, m in answered],
                yerr=np.array(ends).reshape(-1, 2).T,
                fmt="o",
                ms=3,
                lw=0.7,
                color=colour,
                label=fruit,
            )
            limit_axis.plot(
                [one.rupture_n for one in mine],
                [one.force_n for one in mine],
                "o",
                ms=4,
                color=colour,
                label=fruit,
            )
        for axis in (force_axis, limit_axis):
            axis.axline((1, 1), slope=1, color=GREY, lw=0.8, label="equal")
            axis.set(xscale="log", yscale="log")
            for scale in (axis.xaxis, axis.yaxis):
                scale.set_major_locator(FixedLocator(FORCES_N))
                scale.set_major_formatter("{x:g}")
                scale.set_minor_locator(NullLocator())
        force_axis.set(xlabel="true grip force (N)", ylabel="reported force, with its interval (N)")
        limit_axis.set(xlabel="force of rupture (N)", ylabel="true grip force (N)")
        limit_axis.set_title("above the line: ruptured")
        legend_below(figure, axes)
        figure.suptitle("Recorded fruit on recorded sheets (simulated grasps)")
    return figure
