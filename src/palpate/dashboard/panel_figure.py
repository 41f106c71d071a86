"""Figures of matplotlib in the panel: one at a time, with letters that can be read."""

from __future__ import annotations

from collections.abc import Callable
from threading import Lock
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Width of the panel's body, inches, at which letters of 8 points are 12 pixels high.
_WIDTH_IN = 3.5
#: matplotlib's settings belong to the process.
_DRAWING = Lock()


def panel_svg(draw: Callable[[], Figure], *, label: str, height_in: float = 2.3) -> str:
    """Return a figure as SVG for the panel; `label` describes it for those who can't see it.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    from palpate.plots.inline_svg import inline_svg

    with _DRAWING:
        figure = draw()
        figure.set_size_inches(_WIDTH_IN, height_in)
        return inline_svg(figure, label=label)
