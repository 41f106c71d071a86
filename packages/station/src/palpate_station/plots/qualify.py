"""Figures of a qualification: grasps over the reference, and their differences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from palpate.plots.style import BLUE, GREY, ORANGE
from palpate_station.plots.inline_svg import page_figure
from palpate_station.qualify.agreement import Agreement

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def readings_figure(found: Agreement, *, unit: str) -> Figure:
    """Draw converted grasps over reference readings, with the line of equality."""
    ends = [
        min(found.read.min(), found.converted.min()),
        max(found.read.max(), found.converted.max()),
    ]
    with page_figure() as (figure, (axis,)):
        axis.plot(ends, ends, "-", color=GREY, lw=1.0)
        axis.plot(found.read, found.converted, "o", color=BLUE, ms=3.5, alpha=0.6, mew=0)
        axis.set_xlabel(f"reference{unit}")
        axis.set_ylabel(f"grasp, converted{unit}")
    return figure


def differences_figure(found: Agreement, *, unit: str) -> Figure:
    """Draw the difference of each pair over its mean, with the limits of agreement."""
    with page_figure() as (figure, (axis,)):
        middle = (found.read + found.converted) / 2.0
        axis.plot(middle, found.difference, "o", color=BLUE, ms=3.5, alpha=0.6, mew=0)
        limit = found.figures["limit_of_agreement"].value
        axis.axhline(0.0, color=GREY, lw=1.0)
        for value in (-limit, limit):
            axis.axhline(value, color=ORANGE, ls="--", lw=1.2)
            axis.annotate(
                f"{value:+.2f}",
                (1.0, value),
                xycoords=("axes fraction", "data"),
                xytext=(-2, 2),
                textcoords="offset points",
                ha="right",
                fontsize=8,
            )
        span = float(np.abs(found.difference).max())
        axis.set_ylim(-1.15 * span, 1.15 * span)
        axis.set_xlabel(f"mean of both{unit}")
        axis.set_ylabel(f"grasp minus reference{unit}")
    return figure
