"""The best, the median and the worst press, as palpate and a static law followed them."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate_studies.press_follow import Followed

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def draw_followed(
    observed: Sequence[Followed], static: Sequence[Followed], *, stretched: bool = False
) -> Figure:
    """Draw palpate's best, median and worst press, each with the static law's answer.

    What is stretched loses some percent of its force: shown large, not from 0 on.
    """
    from palpate.plots.style import new_figure

    order = np.argsort([np.median(np.abs(one.log_error)) for one in observed])
    places = {"best": order[0], "median": order[len(order) // 2], "worst": order[-1]}
    with new_figure(columns=3, width_in=10.5, height_in=2.8) as (figure, panels):
        for panel, (name, place) in zip(panels[0], places.items(), strict=True):
            _draw_press(panel, observed[place], static[place])
            press = observed[place].press
            which = "" if stretched else f", press {press.press}"
            panel.set_title(f"{name}{which}\n{fill(press.recording_id, 32)}", fontsize=7)
            panel.set(xlabel="time since the force was given (s)", ylabel="force (N)")
            if not stretched:
                panel.set_ylim(0, None)
        panels[0, 0].legend(fontsize=7)
    return figure


def _draw_press(panel: Any, observed: Followed, static: Followed) -> None:
    trace = observed.press.trace
    clock = trace.time_s - trace.time_s[trace.told]
    shown = clock > -0.6
    panel.plot(clock[shown], trace.force_n[shown], color="#222222", lw=1.6, label="load cell")
    panel.plot([0], [observed.told_n], "o", color="#222222", ms=5, label="given")
    panel.fill_between(
        observed.time_s, observed.low_n, observed.high_n, color="#0072B2", alpha=0.2, lw=0
    )
    panel.plot(observed.time_s, observed.value_n, color="#0072B2", lw=1.3, label="palpate")
    panel.plot(static.time_s, static.value_n, color="#D55E00", lw=1.1, ls="--", label="static")
