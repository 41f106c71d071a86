"""Figures of reports: content, and None without data."""

from __future__ import annotations

from palpate.plots.style import INK
from palpate_station.plots.inline_svg import THEME, inline_svg, page_figure


def test_inline_svg_uses_css_variables_and_escapes_text() -> None:
    with page_figure() as (figure, (axis,)):
        axis.plot([0, 1], [0, 1], color=INK)
        axis.set_title("<b>")
        text = inline_svg(figure, label='a "label"')
    assert text.startswith("<svg")
    assert 'aria-label="a &quot;label&quot;"' in text
    assert "&lt;b&gt;" in text
    assert "var(--ink)" in text
    assert "var(--grid)" in text
    assert 'width="' not in text.split(">")[0]
    assert not any(colour.lower() in text.lower() for colour, _, _, _ in THEME)
