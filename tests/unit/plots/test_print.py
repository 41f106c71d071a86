"""Figures: editable text, minus signs, axis labels, colours and titles."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from tests.pdf_fonts import check_fonts

from palpate.holds import Hold
from palpate.plots.pixel_colors import FALL, RISE, is_dark, pixel_color
from palpate.plots.settle import Panel, settle_figure
from palpate.plots.style import (
    PLOT_ENDINGS,
    legend_below,
    letter_panels,
    log_axis,
    new_figure,
    save_figure,
)


@pytest.mark.slow
def test_figure_in_each_format_has_text_and_300_dots_per_inch(tmp_path: Path) -> None:
    with new_figure(columns=2) as (figure, axes):
        axes[0, 0].plot([-20.0, 0.0], [-40.0, 0.0])
        axes[0, 0].set_xlabel("change of resistance, %")
        axes[0, 1].plot([1.0, 2.0], [0.7, 6.0])
        log_axis(axes[0, 1].yaxis)
    for ending in PLOT_ENDINGS:
        save_figure(figure, tmp_path / f"plot{ending}")
    text = (tmp_path / "plot.svg").read_text()
    assert "change of resistance, %" in text
    labels = set(re.findall(r"<text[^>]*>([^<]*)</text>", text))
    assert "\N{MINUS SIGN}20" in labels
    # A logarithmic axis within one decade has labels.
    assert {"1", "2", "5"} <= labels
    check_fonts(tmp_path / "plot.pdf")
    width = int.from_bytes((tmp_path / "plot.png").read_bytes()[16:20])
    assert width == 2100, "7 inches at 300 dots"


def test_legend_below_long_names_fit_the_figure() -> None:
    """Check that long names reduce the number of columns."""
    with new_figure(columns=1, width_in=7.2, height_in=4.4) as (figure, axes):
        for name in ("short", "a long name " * 6, "another long name " * 4):
            axes[0, 0].plot([0, 1], [0, 1], label=name)
        legend_below(figure, axes, entry_in=2.3)
    (legend,) = figure.legends
    assert 0 < legend.get_window_extent().width <= figure.bbox.width
    assert legend.get_texts()[0].get_text() == "short"


@pytest.mark.parametrize(("arm", "sign"), [(FALL, -1), (RISE, 1)])
def test_pixel_color_becomes_lighter_with_the_change(
    arm: tuple[tuple[int, int, int], ...], sign: int
) -> None:
    light = [0.3 * red + 0.6 * green + 0.1 * blue for red, green, blue in arm]
    assert light == sorted(light)
    steps = [pixel_color(sign * percent) for percent in (0.0, 20.0, 40.0, 60.0, 80.0)]
    assert steps == list(arm)
    assert is_dark(0.0)
    assert not is_dark(sign * 80.0)


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
