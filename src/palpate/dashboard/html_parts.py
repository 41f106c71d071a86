"""Headings and paragraphs of the panels, from plain text."""

from __future__ import annotations

import html
from datetime import datetime

from nicegui import ui


def heading(text: str) -> ui.html:
    """Add a heading."""
    return ui.html(f"<h3>{html.escape(text)}</h3>", sanitize=False)


def paragraph(text: str) -> ui.html:
    """Add a paragraph."""
    return ui.html(f"<p>{html.escape(text)}</p>", sanitize=False)


def number_text(value: float, spec: str) -> str:
    """Return a number as `format` writes it, with a minus sign in place of a hyphen."""
    return format(float(value), spec).replace("-", "\N{MINUS SIGN}")


def day_text(moment: datetime) -> str:
    """Return day and time of a moment."""
    return moment.strftime("%d %b %H:%M")


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, such as ``2 faults``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
