"""Colour map of a pixel's relative change, for pages, terminal, reports and plots.

The centre of the map (no change) is dark. A decrease of the resistance is shown from red to pale
yellow (colours of matplotlib's inferno), an increase from blue to pale blue. Both sides become
lighter, so colour-blind readers can distinguish a change from rest. The sign in each pixel
distinguishes decrease and increase.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap

#: Change at both ends of the map, percent.
DEEPEST_PERCENT = 80.0
#: Colours from rest to the largest decrease and increase: red, green, blue, 0 to 255.
FALL = ((20, 18, 46), (101, 21, 110), (212, 72, 66), (250, 193, 39), (252, 255, 164))
RISE = ((20, 18, 46), (22, 62, 116), (40, 118, 184), (110, 182, 232), (196, 232, 252))


def pixel_color(change_percent: float) -> tuple[int, int, int]:
    """Return the colour of a relative change.

    Examples
    --------
    >>> pixel_color(0.0), pixel_color(-80.0), pixel_color(500.0)
    ((20, 18, 46), (252, 255, 164), (196, 232, 252))
    """
    stops = np.array(FALL if change_percent <= 0 else RISE)
    position = min(abs(change_percent) / DEEPEST_PERCENT, 1.0) * (len(stops) - 1)
    red, green, blue = (
        round(float(np.interp(position, range(len(stops)), channel))) for channel in stops.T
    )
    return red, green, blue


def is_dark(change_percent: float) -> bool:
    """Return whether text on the colour of this change must be light.

    Examples
    --------
    >>> is_dark(-5.0), is_dark(-70.0)
    (True, False)
    """
    red, green, blue = pixel_color(change_percent)
    return 0.3 * red + 0.6 * green + 0.1 * blue <= 120


def terminal_style(percent: float) -> str:
    """Return the style of a pixel in a terminal: its color, and a readable ink.

    >>> terminal_style(0.0).split()[:2]
    ['white', 'on']
    """
    red, green, blue = pixel_color(percent)
    return f"{'white' if is_dark(percent) else 'black'} on rgb({red},{green},{blue})"


def change_colormap() -> LinearSegmentedColormap:
    """Return the matplotlib colour map, from -80 % (0) to 80 % (1)."""
    from matplotlib.colors import LinearSegmentedColormap

    stops = [*reversed(FALL), *RISE[1:]]
    return LinearSegmentedColormap.from_list("palpate-change", np.array(stops) / 255.0)


def css_gradient() -> str:
    """Return the map as a CSS gradient, starting at the largest decrease.

    Examples
    --------
    >>> css_gradient()[:45]
    'linear-gradient(90deg, rgb(252 255 164), rgb('
    """
    stops = (f"rgb({red} {green} {blue})" for red, green, blue in (*reversed(FALL), *RISE[1:]))
    return f"linear-gradient(90deg, {', '.join(stops)})"
