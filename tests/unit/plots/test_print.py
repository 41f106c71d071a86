"""Figures for print: editable text, minus signs, axis labels and colours."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from palpate.plots.pixel_colors import FALL, RISE, change_colormap, is_dark, pixel_color
from palpate.plots.style import PLOT_ENDINGS, legend_below, log_axis, new_figure, save_figure


@pytest.fixture
def figure_folder(tmp_path: Path) -> Path:
    """Write a figure with a negative and a logarithmic axis in every format."""
    with new_figure(columns=2) as (figure, axes):
        axes[0, 0].plot([-20.0, 0.0], [-40.0, 0.0])
        axes[0, 0].set_xlabel("change of resistance, %")
        axes[0, 1].plot([1.0, 2.0], [0.7, 6.0])
        log_axis(axes[0, 1].yaxis)
    for ending in PLOT_ENDINGS:
        save_figure(figure, tmp_path / f"plot{ending}")
    return tmp_path


@pytest.mark.slow
def test_svg_contains_text_with_minus_signs(figure_folder: Path) -> None:
    text = (figure_folder / "plot.svg").read_text()
    assert "change of resistance, %" in text
    labels = re.findall(r"<text[^>]*>([^<]*)</text>", text)
    assert "\N{MINUS SIGN}20" in labels
    assert not [label for label in labels if re.match(r"-\d", label)]


@pytest.mark.slow
def test_pdf_contains_editable_fonts(figure_folder: Path) -> None:
    document = (figure_folder / "plot.pdf").read_bytes()
    assert b"/FontType 42" in document or b"/Type0" in document
    assert b"/Type3" not in document


@pytest.mark.slow
def test_log_axis_within_one_decade_has_tick_labels(figure_folder: Path) -> None:
    labels = re.findall(r"<text[^>]*>([^<]*)</text>", (figure_folder / "plot.svg").read_text())
    assert {"1", "2", "5"} <= set(labels)


def test_log_axis_aligns_minor_and_major_labels() -> None:
    with new_figure() as (figure, axes):
        axes[0, 0].plot([0.02, 2.0], [0.0, 1.0])
        log_axis(axes[0, 0].xaxis)
    figure.draw_without_rendering()
    labels = axes[0, 0].xaxis.get_ticklabels(which="both")
    tops = [one.get_window_extent().y1 for one in labels if one.get_text() in {"0.1", "0.2", "0.5"}]
    assert len(tops) == 3
    assert max(tops) - min(tops) < 0.5


def test_legend_below_long_names_fit_the_figure() -> None:
    """Check that long names reduce the number of columns."""
    with new_figure(columns=1, width_in=7.2, height_in=4.4) as (figure, axes):
        for name in ("short", "a long name " * 6, "another long name " * 4):
            axes[0, 0].plot([0, 1], [0, 1], label=name)
        legend_below(figure, axes, entry_in=2.3)
    (legend,) = figure.legends
    assert 0 < legend.get_window_extent().width <= figure.bbox.width
    assert legend.get_texts()[0].get_text() == "short"


def test_legend_below_orders_entries_row_by_row() -> None:
    names = ["before", "after", "alone", "before, published", "after, published"]
    with new_figure() as (figure, axes):
        for name in names:
            axes[0, 0].plot([0.0, 1.0], label=name)
        legend_below(figure, axes, entry_in=2.3)
    figure.draw_without_rendering()
    places = {}
    for text in figure.legends[0].get_texts():
        box = text.get_window_extent()
        places[text.get_text()] = (-round(box.y0 / 10), box.x0)
    assert sorted(places, key=places.__getitem__) == names


def test_png_has_300_dots_per_inch(figure_folder: Path) -> None:
    header = (figure_folder / "plot.png").read_bytes()[16:20]
    assert int.from_bytes(header) == 2100, "7 inches at 300 dots"


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


def test_change_colormap_agrees_with_pixel_color() -> None:
    colors = change_colormap()
    for percent in (-80.0, 0.0, 80.0):
        red, green, blue, _ = colors((percent + 80.0) / 160.0)
        expected = [channel / 255 for channel in pixel_color(percent)]
        assert [red, green, blue] == pytest.approx(expected, abs=0.02)
