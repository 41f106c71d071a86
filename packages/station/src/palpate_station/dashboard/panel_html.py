"""HTML of the panels: macros of `panels.html.j2`, and matplotlib figures as SVG."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Callable
from datetime import datetime
from functools import cache
from threading import Lock
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from palpate.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def panel_html(part: str, **values: object) -> str:
    """Render a macro of `panels.html.j2`; values are escaped except `Markup`."""
    return str(getattr(_parts(), part)(**values))


@cache
def _parts() -> Any:
    environment = Environment(
        loader=PackageLoader("palpate_station.dashboard", ""),
        autoescape=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    environment.filters |= {
        "count_of": count_of,
        "day": day_text,
        "largest": _largest,
        "num": _number,
        "quote": lambda text: quote(text, safe=""),
        "sentence": _sentence,
    }
    return environment.get_template("panels.html.j2").module


def day_text(moment: datetime | str) -> str:
    """Return a time as day and time in the local time zone."""
    if isinstance(moment, str):
        moment = datetime.fromisoformat(moment)
    return moment.astimezone().strftime("%d %b %H:%M")


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun in singular or plural, such as ``2 faults``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _largest(values: FloatArray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0)) or 1.0


def _number(value: float, spec: str) -> str:
    """Format a number with a typographic minus sign; non-finite numbers become ``open``."""
    if not math.isfinite(value):
        return "open"
    return format(float(value), spec).replace("-", "\N{MINUS SIGN}")


def _sentence(text: str) -> Markup:
    """Convert the terminal text of a finding to an HTML sentence."""
    signed = re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", html.escape(text))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", signed) + ".")


#: Figure width, inches; at the panel's width, 8-point letters are then 12 pixels high.
_WIDTH_IN = 3.5
#: matplotlib's settings are global, so only one figure is drawn at a time.
_DRAWING = Lock()


def draw_panel_svg(draw: Callable[[], Figure], *, label: str, height_in: float = 2.3) -> str:
    """Draw a figure and return it as SVG; `label` is the text for screen readers.

    Raises
    ------
    MissingExtraError
        If matplotlib is not installed.
    """
    from palpate_station.plots.inline_svg import inline_svg

    with _DRAWING:
        figure = draw()
        figure.set_size_inches(_WIDTH_IN, height_in)
        return inline_svg(figure, label=label)
