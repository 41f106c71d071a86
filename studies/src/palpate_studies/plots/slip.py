"""Share of events that have been seen by a time after they began."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from palpate.plots.style import BLUE, ORANGE, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def delay_figure(delays_s: Mapping[str, Mapping[str, Sequence[float | None]]]) -> Figure:
    """Draw the share seen against the time since the beginning.

    Parameters
    ----------
    delays_s : mapping of str to mapping of str to sequence
        Level -> kind of event -> delays, None where it was missed.
    """
    with new_figure(columns=len(delays_s), width_in=4.0 * len(delays_s), height_in=3.2) as (
        figure,
        axes,
    ):
        for axis, (level, kinds) in zip(axes[0], delays_s.items(), strict=True):
            for (kind, delays), colour in zip(kinds.items(), (BLUE, ORANGE), strict=True):
                seen = np.sort([delay for delay in delays if delay is not None])
                share = np.arange(1, seen.size + 1) / max(len(delays), 1)
                axis.step(
                    np.concatenate([[0.0], seen, [1.0]]),
                    100 * np.concatenate([[0.0], share, share[-1:] if share.size else [0.0]]),
                    where="post",
                    color=colour,
                    label=f"{kind} ({len(delays)})",
                )
            axis.set(
                xlabel="time since the beginning (s)",
                title=f"simulated, {level}",
                xlim=(0, 1),
                ylim=(0, 104),
            )
            axis.legend(loc="lower right")
        axes[0][0].set_ylabel("seen (%)")
        figure.suptitle("Simulated slips and removals, frames at 15 Hz")
    return figure
