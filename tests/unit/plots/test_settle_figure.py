"""Panels of holds: titles neither overlap nor leave the page."""

from __future__ import annotations

import numpy as np
from matplotlib.text import Text

from palpate.holds import Hold
from palpate.plots.settle import Panel, settle_figure
from palpate.plots.style import letter_panels


def test_settle_figure_long_titles_do_not_overlap() -> None:
    time_s = np.arange(0.0, 20.0, 0.1)
    names = [f"q15late_press_60s_15_a{n}_9346f7" for n in range(3)]
    panels = [
        Panel(
            title=f"{name}\nerror +6.7 % of settled, 30 % of the rest",
            hold=Hold(hold_id=name, channel=None, time_s=time_s, values=np.exp(-time_s)),
            cutoff_s=2.5,
        )
        for name in names
    ]
    figure = settle_figure(panels, methods={}, horizon_s=20.0, level=0.9)
    letter_panels(figure)
    figure.draw_without_rendering()
    boxes = [
        one.get_window_extent()
        for one in figure.findobj(Text)
        if isinstance(one, Text) and (one.get_text() in "abc" or one.get_text()[:3] == "q15")
        if one.get_text()
    ]
    assert len(boxes) == 6
    assert not any(a.overlaps(b) for i, a in enumerate(boxes) for b in boxes[:i])
    assert max(one.x1 for one in boxes) <= figure.bbox.x1
