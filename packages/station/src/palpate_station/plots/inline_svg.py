"""Figures as inline SVG with the fonts and the colours of a page."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from palpate.plots.style import AMBER, BLUE, GREEN, GREY, INK, ORANGE, PURPLE, SKY, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_GRID, _PAPER = "#E4E4E4", "#FFFFFF"
#: Colour in a figure, name of the page's CSS variable, colour in the light and in the dark theme.
#: The dark theme has lighter colours of the same hue, which colour-blind readers can distinguish.
THEME: tuple[tuple[str, str, str, str], ...] = (
    (INK, "--ink", "#1c1f23", "#e8eaed"),
    (GREY, "--grey", "#6b7178", "#9aa1a9"),
    (_GRID, "--grid", "#e3e6e9", "#33383e"),
    (_PAPER, "--card", "#ffffff", "#1b1f24"),
    (BLUE, "--blue", "#0072b2", "#4ba3dc"),
    (ORANGE, "--orange", "#d55e00", "#f08a3c"),
    (GREEN, "--green", "#009e73", "#2fc49a"),
    (PURPLE, "--purple", "#b85f90", "#d98fb7"),
    (SKY, "--sky", "#3a9bd0", "#8ccdf2"),
    (AMBER, "--amber", "#c98700", "#f0b429"),
)
_UNUSED_IDS = "figure|axes|patch|line2d|text|xtick|ytick|matplotlib|legend|LineC|Path|Quad|Fill"
_INK_EVERYWHERE: dict[Any, Any] = {
    "text.color": INK,
    "axes.labelcolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
}


@contextmanager
def page_figure(*, columns: int = 1, height_in: float = 2.9) -> Iterator[tuple[Figure, Any]]:
    """Yield a figure with a transparent background for a page, and its row of axes."""
    import matplotlib as mpl

    with (
        mpl.rc_context(_INK_EVERYWHERE),
        new_figure(columns=columns, width_in=5.4, height_in=height_in) as (figure, axes),
    ):
        figure.patch.set_visible(False)
        for axis in axes[0]:
            axis.patch.set_visible(False)
        yield figure, axes[0]


def inline_svg(figure: Figure, *, label: str) -> str:
    """Return a figure as an ``<svg>`` element with the page's colours and font.

    Parameters
    ----------
    figure : Figure
        From `page_figure`.
    label : str
        Description of the figure for screen readers.
    """
    import matplotlib as mpl

    stream = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": label}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    # Remove unused IDs, which would be duplicates on a page with two figures.
    text = re.sub(rf' id="(?:{_UNUSED_IDS})[^"]*"', "", text)
    # One of two forms, depending on the version of matplotlib.
    text = re.sub(r"font-family: [^;\"]*;?", "", text)
    text = re.sub(r"(font: [^;\"]*px)[^;\"]*", r"\1 var(--font)", text)
    for colour, variable, _, _ in THEME:
        text = re.sub(re.escape(colour), f"var({variable})", text, flags=re.IGNORECASE)
    head, rest = text.split(">", 1)
    head = re.sub(r' (?:width|height)="[^"]*"', "", head)
    return f'{head} role="img" aria-label="{html.escape(label)}">{rest}'
