"""The reports of a batch and of a day: how many of what, how firm, where they went."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from datetime import date

import numpy as np

from palpate.commands.report_html import Tile, figures, html_page, table, tiles
from palpate.commands.report_item import number, when
from palpate.grasp.result import Outcome
from palpate.plots.inline_svg import inline_svg
from palpate.plots.many_items import (
    counts_figure,
    hours_figure,
    kind_of,
    size_stiffness_figure,
    softening_figure,
)
from palpate.produce.records import About, Grasp
from palpate.produce.store.item_history import ItemHistory

_MOST_ROWS = 500
_FOOT = (
    "From the {store}. Each item is listed with its last grasp; * marks readings whose interval "
    "promises less than level 0.9. Times are local."
)


def batch_report(name: str, pages: Sequence[ItemHistory], *, store: str) -> str:
    """Return the report of a batch as HTML: all grasps of its items."""
    grasps = [grasp for page in pages for grasp in page.grasps]
    body = [tiles(_tiles(pages, grasps))]
    shown = _figures(pages)
    if (softening := softening_figure(pages)) is not None:
        caption = "Softening: stiffness of each item over its days"
        shown.insert(0, (caption, inline_svg(softening, label=caption)))
    body.append(figures(shown))
    body.append(_items(pages))
    return html_page(
        title=f"Batch {name}",
        chips=_chips(pages, grasps),
        simulated=any(grasp.simulated for grasp in grasps),
        body=body,
        foot=_FOOT.format(store=store),
    )


def day_report(day: date, pages: Sequence[ItemHistory], *, store: str) -> str:
    """Return the report of a day as HTML, from the pages of its items within that day."""
    grasps = [grasp for page in pages for grasp in page.grasps]
    caption = "Grasps over the day"
    hours = (caption, inline_svg(hours_figure(grasps), label=caption))
    return html_page(
        title=f"{day:%A}, {day.day} {day:%B %Y}",
        chips=_chips(pages, grasps),
        simulated=any(grasp.simulated for grasp in grasps),
        body=[
            tiles(_tiles(pages, grasps)),
            figures([hours, *_figures(pages)]),
            _items(pages),
        ],
        foot=_FOOT.format(store=store),
    )


def _chips(pages: Sequence[ItemHistory], grasps: Sequence[Grasp]) -> list[str]:
    chips = [kind for kind, _ in Counter(map(kind_of, pages)).most_common(4)]
    if grasps:
        first, last = (when(end(grasp.taken_at for grasp in grasps)) for end in (min, max))
        day, _, clock = last.partition(" ")
        chips.append(f"{first} to {clock if first.startswith(day) else last}")
    return chips


def _tiles(pages: Sequence[ItemHistory], grasps: Sequence[Grasp]) -> list[Tile]:
    held = sum(grasp.outcome is Outcome.HELD for grasp in grasps)
    share = f"{100 * held / len(grasps):.0f} % held" if grasps else ""
    shown = [
        Tile(name="Items", value=f"{len(pages)}"),
        Tile(name="Grasps", value=f"{len(grasps)}", below=share),
    ]
    for name, caption, unit, digits in (
        ("firmness", "Median firmness", "of 100", 0),
        ("stiffness_n_per_mm", "Median stiffness", "N/mm", 2),
        ("size_mm", "Median size", "mm", 1),
    ):
        values = [measured.middle for page in pages if (measured := page.latest(name))]
        if values:
            low, middle, high = np.quantile(values, [0.1, 0.5, 0.9])
            below = f"8 in 10: {low:.{digits}f} to {high:.{digits}f}"
            value = f"{middle:.{digits}f}"
            shown.append(Tile(name=caption, value=value, unit=unit, below=below))
    bruised = [verdict for page in pages if (verdict := page.latest_verdict(About.BRUISE))]
    if bruised:
        counts = Counter(verdict.text for verdict in bruised)
        text, many = counts.most_common(1)[0]
        below = f"of {len(bruised)} looked at"
        shown.append(Tile(name="Bruise", value=f"{many}", unit=text, below=below))
    return shown


def _figures(pages: Sequence[ItemHistory]) -> list[tuple[str, str]]:
    shown = []
    if (cloud := size_stiffness_figure(pages)) is not None:
        caption = "Size and stiffness, by kind"
        shown.append((caption, inline_svg(cloud, label=caption)))
    for about, caption in ((About.RIPENESS, "Ripeness"), (About.BIN, "Bins")):
        counts = Counter(verdict.text for page in pages if (verdict := page.latest_verdict(about)))
        if counts:
            shown.append((caption, inline_svg(counts_figure(counts.most_common(8)), label=caption)))
    return shown


def _items(pages: Sequence[ItemHistory]) -> str:
    columns = [
        "item",
        "kind",
        "last grasp",
        ">grasps",
        ">size, mm",
        ">firmness",
        ">stiffness, N/mm",
    ]
    # A subject without any verdict gets no column.
    abouts = [
        about
        for about in (About.RIPENESS, About.BRUISE, About.BIN)
        if any(page.latest_verdict(about) for page in pages)
    ]
    rows = [
        [
            page.item.item_id,
            kind_of(page),
            when(page.grasps[-1].taken_at) if page.grasps else "-",
            f"{len(page.grasps)}",
            number(page.latest("size_mm"), 1),
            number(page.latest("firmness"), 0),
            number(page.latest("stiffness_n_per_mm"), 2),
            *(verdict.text if (verdict := page.latest_verdict(about)) else "-" for about in abouts),
        ]
        for page in pages[:_MOST_ROWS]
    ]
    more = len(pages) > _MOST_ROWS
    caption = f"Items (the first {_MOST_ROWS} of {len(pages)})" if more else "Items"
    return table(caption, [*columns, *map(str, abouts)], rows)
