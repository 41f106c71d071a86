"""HTML of the panels: parts of `panels.html.j2`, and figures of matplotlib."""

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
    """Return a part with these values; all that is not `Markup` is escaped."""
    return str(getattr(_parts(), part)(**values))


@cache
def _parts() -> Any:
    environment = Environment(
        loader=PackageLoader("palpate.dashboard", ""),
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
    """Return a time as day and time of this machine's zone."""
    if isinstance(moment, str):
        moment = datetime.fromisoformat(moment)
    return moment.astimezone().strftime("%d %b %H:%M")


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, such as ``2 faults``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _largest(values: FloatArray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0)) or 1.0


def _number(value: float, spec: str) -> str:
    """Return a number formatted by `format`, with a minus sign in place of a hyphen."""
    if not math.isfinite(value):
        return "open"
    return format(float(value), spec).replace("-", "\N{MINUS SIGN}")


def _sentence(found: str) -> Markup:
    """Return a finding's terminal text as HTML."""
    signed = re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", html.escape(found))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", signed) + ".")


#: Width of the panel's body, inches, at which letters of 8 points are 12 pixels high.
_WIDTH_IN = 3.5
#: matplotlib's settings belong to the process.
_DRAWING = Lock()


def panel_svg(draw: Callable[[], Figure], *, label: str, height_in: float = 2.3) -> str:
    """Return a figure as SVG for the panel; `label`: its text for screen readers.

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
