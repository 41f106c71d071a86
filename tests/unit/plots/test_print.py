"""Figures: editable text, minus signs, axis labels, colours and titles."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from tests.pdf_fonts import check_fonts

from palpate.plots.style import (
    PLOT_ENDINGS,
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
