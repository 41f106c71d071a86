"""Reports as one self-contained HTML file with light, dark and print styles."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple, TypeAlias

from palpate_station.plots.inline_svg import THEME


class PageTable(NamedTuple):
    """A table; column names with a ``>`` prefix are numeric."""

    caption: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


#: Figures in large type: name -> value, unit, and the line below.
Tiles: TypeAlias = Mapping[str, tuple[str, str, str]]
#: Captions and ``<svg>`` elements.
Figures: TypeAlias = Sequence[tuple[str, str]]
#: Part of a page; a string is a paragraph.
Part: TypeAlias = Tiles | Figures | PageTable | str


def render_page(
    *,
    title: str,
    chips: Iterable[str],
    simulated: bool,
    body: Iterable[Part],
    foot: str,
) -> str:
    """Return a page as HTML; all text except the figures is escaped.

    `chips`: short facts below the title.
    `simulated`: whether to mark the page as simulated.
    Raises `MissingExtraError` if Jinja is not installed.
    """
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("palpate_station.plots", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("report.html.j2").render(
        theme=THEME, title=title, chips=chips, simulated=simulated, body=body, foot=foot
    )
