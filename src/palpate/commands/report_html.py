"""The frame of a report: one HTML file that needs nothing else, by day and by night, on paper."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from palpate.plots.inline_svg import THEME


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One figure in large type: what it is, the value, its unit, the line below it."""

    name: str
    value: str
    unit: str = ""
    below: str = ""


def html_page(
    *, title: str, chips: Iterable[str], simulated: bool, body: Iterable[str], foot: str
) -> str:
    """Return the whole page.

    `chips`: short facts next to it.
    `simulated`: whether to state that any of it is simulated.
    `body`: sections, HTML.
    `foot`: the last line, text.
    """
    marks = "".join(f'<span class="chip">{escape(chip)}</span>' for chip in chips)
    if simulated:
        marks = f'<span class="chip simulated">simulated on the twin</span>{marks}'
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)} · palpate</title><style>{_style()}</style></head>\n<body><main>"
        f'<header><p class="mark">palpate</p><h1>{escape(title)}</h1>'
        f'<p class="chips">{marks}</p></header>\n'
        + "\n".join(body)
        + f"\n<footer>{escape(foot)}</footer></main></body></html>\n"
    )


def tiles(shown: Iterable[Tile]) -> str:
    """Return figures in large type, side by side."""
    inner = "".join(
        f'<div class="tile"><p class="name">{escape(tile.name)}</p>'
        f'<p class="value">{escape(tile.value)} <small>{escape(tile.unit)}</small></p>'
        f'<p class="below">{escape(tile.below)}</p></div>'
        for tile in shown
    )
    return f'<section class="tiles">{inner}</section>'


def figures(shown: Iterable[tuple[str, str]]) -> str:
    """Return figures, each an ``<svg>`` under its caption."""
    inner = "".join(
        f"<figure><figcaption>{escape(caption)}</figcaption>{svg}</figure>"
        for caption, svg in shown
    )
    return f'<section class="figures">{inner}</section>'


def table(caption: str, columns: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; columns whose name begins with ``>`` hold numbers.

    >>> "<th>item</th>" in table("Items", ["item", ">grasps"], [["A<1", "3"]])
    True
    """
    numbers = [name.startswith(">") for name in columns]
    head = "".join(
        f"<th{_number(n)}>{escape(name.lstrip('>'))}</th>"
        for n, name in zip(numbers, columns, strict=True)
    )
    lines = "".join(
        "<tr>"
        + "".join(
            f"<td{_number(n)}>{escape(cell)}</td>" for n, cell in zip(numbers, row, strict=True)
        )
        + "</tr>"
        for row in rows
    )
    return (
        f'<section class="table"><h2>{escape(caption)}</h2><div class="scroll"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div></section>"
    )


def _number(is_number: bool) -> str:
    return ' class="number"' if is_number else ""


def _style() -> str:
    day = "".join(f"{name}:{light};" for _, name, light, _ in THEME)
    night = "".join(f"{name}:{dark};" for _, name, _, dark in THEME)
    return _CSS % {"day": day, "night": night}


_CSS = """
:root{color-scheme:light dark;%(day)s--ground:#f4f5f6;
--font:system-ui,-apple-system,"Segoe UI",Roboto,"Helvetica Neue",Arial,sans-serif}
@media screen and (prefers-color-scheme:dark){:root{%(night)s--ground:#121518}}
*{box-sizing:border-box}
body{margin:0;background:var(--ground);color:var(--ink);font:15px/1.45 var(--font)}
main{max-width:1120px;margin:0 auto;padding:28px 24px 40px}
header{margin-bottom:20px}
.mark{margin:0;color:var(--blue);font-weight:700;font-size:13px;letter-spacing:.06em}
h1{margin:2px 0 8px;font-size:30px;line-height:1.15;overflow-wrap:anywhere}
h2{margin:0 0 8px;font-size:16px}
.chips{margin:0;display:flex;flex-wrap:wrap;gap:6px}
.chip{border:1px solid var(--grid);background:var(--card);border-radius:99px;padding:2px 11px;
font-size:13px}
.simulated{border-color:var(--amber);color:var(--amber);font-weight:600}
.tiles{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px}
.tile,figure,.table{background:var(--card);border:1px solid var(--grid);border-radius:10px}
.tile{padding:12px 14px}
.tile p{margin:0;overflow-wrap:anywhere}
.name{color:var(--grey);font-size:13px}
.value{font-size:22px;font-weight:650;line-height:1.3;overflow-wrap:anywhere;
font-variant-numeric:tabular-nums}
.value small{font-size:14px;font-weight:500;color:var(--grey);white-space:nowrap}
.below{color:var(--grey);font-size:13px;min-height:1.45em}
.figures{display:grid;grid-template-columns:repeat(2,minmax(0,1fr));gap:12px;margin:12px 0}
@media screen and (max-width:640px){.figures{grid-template-columns:1fr}}
figure{margin:0;padding:12px 14px 8px;display:flex;flex-direction:column}
figcaption{font-weight:600;font-size:14px;margin-bottom:6px}
figure svg{width:100%%;height:auto;max-height:420px;margin:auto 0;display:block}
.table{padding:14px 16px 8px;margin-top:12px}
.scroll{overflow-x:auto}
table{border-collapse:collapse;width:100%%;font-size:14px}
th{color:var(--grey);font-weight:500;text-align:left;white-space:nowrap}
th,td{padding:5px 14px 5px 0;vertical-align:top}
tbody tr{border-top:1px solid var(--grid)}
td{font-variant-numeric:tabular-nums}
td:first-child{white-space:nowrap}
td:last-child:not(.number){min-width:14em}
.number+:not(.number){padding-left:14px}
.number{text-align:right;white-space:nowrap}
footer{color:var(--grey);font-size:13px;margin-top:18px}
@media print{body{background:#fff}main{padding:0}figure,.tile,tr{break-inside:avoid}}
"""
