"""Headings and paragraphs of the panels, from plain text."""

from __future__ import annotations

import html

from nicegui import ui


def heading(text: str) -> ui.html:
    """Add a heading."""
    return ui.html(f"<h3>{html.escape(text)}</h3>", sanitize=False)


def paragraph(text: str) -> ui.html:
    """Add a paragraph."""
    return ui.html(f"<p>{html.escape(text)}</p>", sanitize=False)
