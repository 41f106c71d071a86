"""One colour map for a pixel's relative change, on pages, terminal, reports and plots.

It diverges from dark, because nothing pressed is the usual case: a fall of the resistance goes
through red to pale yellow (points of matplotlib's inferno), a rise through blue to pale blue. Both
arms grow lighter, so they differ from rest without colour vision, and from each other by
the sign that is printed in each pixel.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.colors import LinearSegmentedColormap

#: Change at which both arms end, percent.
DEEPEST_PERCENT = 80.0
#: From rest to the deepest fall, and from rest to the highest rise: red, green, blue, 0 to 255.
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
    place = min(abs(change_percent) / DEEPEST_PERCENT, 1.0) * (len(stops) - 1)
    red, green, blue = (
        round(float(np.interp(place, range(len(stops)), channel))) for channel in stops.T
    )
    return red, green, blue


def is_dark(change_percent: float) -> bool:
    """Return whether words on this colour must be light.

    Examples
    --------
    >>> is_dark(-5.0), is_dark(-70.0)
    (True, False)
    """
    red, green, blue = pixel_color(change_percent)
    return 0.3 * red + 0.6 * green + 0.1 * blue <= 120


def change_colormap() -> LinearSegmentedColormap:
    """Return it as a matplotlib colour map, from -80 % (0) to 80 % (1)."""
    from matplotlib.colors import LinearSegmentedColormap

    stops = [*reversed(FALL), *RISE[1:]]
    return LinearSegmentedColormap.from_list("palpate-change", np.array(stops) / 255.0)


def css_gradient() -> str:
    """Return the map as a CSS gradient, the deepest fall first.

    Examples
    --------
    >>> css_gradient()[:45]
    'linear-gradient(90deg, rgb(252 255 164), rgb('
    """
    stops = (f"rgb({red} {green} {blue})" for red, green, blue in (*reversed(FALL), *RISE[1:]))
    return f"linear-gradient(90deg, {', '.join(stops)})"
