"""Readings of several objects over time, at one width: Figures 8b and 9b of the paper."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from palpate.signal.relative import mean_change
from palpate.twin.objects import TwinObject
from palpate_studies.rows import LEVELS
from palpate_studies.twin_session import Session, stack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Where the published settled values are drawn: next to the end of the curves, at 20 s.
PUBLISHED_AT_S = 21.0
#: Sensor and grasps that are drawn.
SHOWN_SENSOR, SHOWN_GRASPS = 0, 5


def draw_curves(
    objects: Mapping[str, TwinObject],
    *,
    width_mm: float,
    title: str,
    published: Mapping[str, tuple[float, float]],
    fixture: bool = False,
) -> Figure:
    """Draw mean and standard deviation over a few grasps of each object, level by level.

    Parameters
    ----------
    objects : mapping of str to TwinObject
        Label -> what is grasped.
    width_mm : float
        Width that the fingers close to.
    title : str
        The figure of the paper.
    published : mapping of str to (float, float)
        Label -> published mean and standard deviation of the settled change, percent.
    fixture : bool
        Whether objects lie in the middle, within 1 mm.
    """
    from palpate.plots.style import AMBER, BLUE, GREEN, INK, ORANGE, PURPLE, SKY, new_figure

    with new_figure(columns=2, width_in=9.0, height_in=3.8) as (figure, axes):
        for axis, level in zip(axes[0], LEVELS, strict=True):
            drawn = zip(objects.items(), (PURPLE, GREEN, ORANGE, BLUE, SKY, AMBER), strict=False)
            for rank, ((label, obj), colour) in enumerate(drawn):
                session = Session(SHOWN_SENSOR, level=level)
                session.place(obj, fixture=fixture)
                curves = stack(
                    [
                        mean_change(session.hold(obj.size_mm, width_mm=width_mm))
                        for _ in range(SHOWN_GRASPS)
                    ]
                )
                time_s = np.arange(1, curves.shape[1] + 1) / session.world.frame_rate_hz
                mean, sd = curves.mean(axis=0), curves.std(axis=0, ddof=1)
                axis.fill_between(time_s, mean - sd, mean + sd, color=colour, alpha=0.25, lw=0)
                axis.plot(time_s, mean, "--", color=colour, label=label)
                at_s = PUBLISHED_AT_S + 0.5 * rank
                axis.errorbar(at_s, *published[label], fmt="o", ms=4, color=colour, capsize=2)
            axis.set(
                xlabel="time from actuation (s)",
                ylabel="mean relative change (%)",
                title=f"{title}, simulated, level {level}",
                ylim=(-102, 25),
            )
            axis.errorbar(
                [], [], [], fmt="o", ms=4, color=INK, capsize=2, label="published, mean ± sd"
            )
        axes[0, 0].legend(ncols=2, loc="upper right", fontsize=7)
    return figure
