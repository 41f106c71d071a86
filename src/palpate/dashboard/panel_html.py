"""HTML of the panels, from the parts of `panels.html.j2`."""

from __future__ import annotations

import html
import math
import re
from datetime import datetime
from functools import cache
from typing import Any
from urllib.parse import quote

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from palpate.arrays import FloatArray


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
    """Return day and time, of this machine's zone, of a moment."""
    if isinstance(moment, str):
        moment = datetime.fromisoformat(moment)
    return moment.astimezone().strftime("%d %b %H:%M")


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, such as ``2 faults``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _largest(values: FloatArray) -> float:
    return float(np.abs(values[np.isfinite(values)]).max(initial=0.0)) or 1.0


def _number(value: float, spec: str) -> str:
    """Return a number as `format` writes it, with a minus sign in place of a hyphen."""
    if not math.isfinite(value):
        return "open"
    return format(float(value), spec).replace("-", "\N{MINUS SIGN}")


def _sentence(found: str) -> Markup:
    """Return words of a finding, which are written for a terminal."""
    signed = re.sub(r"(?<!\w)-(?=\d)", "\N{MINUS SIGN}", html.escape(found))
    return Markup(re.sub("`([^`]+)`", r"<code>\1</code>", signed) + ".")
