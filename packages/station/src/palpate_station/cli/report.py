"""`palpate report`: web page with plots of an item, a batch or a day."""

from __future__ import annotations

import re
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from palpate.cli.options import StoreOption, opt
from palpate.cli.output import format_percent, format_time, print_message
from palpate.errors import InputError
from palpate.files import atomic_path, check_new
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement, Status
from palpate.plots.style import require_plots
from palpate_station.cli.items import (
    VERDICT_COLUMNS,
    find_batch,
    open_store,
    parse_day,
    verdict_rows,
)
from palpate_station.cli.options import BatchOption, DayOption, complete_items
from palpate_station.plots.inline_svg import inline_svg
from palpate_station.plots.item_history import history_figure, pixels_figure
from palpate_station.plots.many_items import (
    counts_figure,
    hours_figure,
    kind_of,
    size_stiffness_figure,
    softening_figure,
)
from palpate_station.plots.report_page import PageTable, Part, render_page
from palpate_station.records import About, Grasp, Source
from palpate_station.ripeness.rule import Days
from palpate_station.ripeness.stages import STAGES
from palpate_station.store.item_history import (
    ItemHistory,
    is_provisional,
    read_item_histories,
    read_item_history,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Name, caption, unit, decimal places.
_QUANTITIES = (
    ("firmness", "Firmness", "of 100", 0),
    ("stiffness_n_per_mm", "Stiffness", "N/mm", 2),
    ("settled_percent", "Settled change", "%", 1),
    ("size_mm", "Size", "mm", 1),
    ("force_n", "Grip force", "N", 2),
)
#: Maximum rows in the tables of grasps and verdicts, and of items (guess).
_MAX_ROWS, _MAX_ITEMS = 100, 500
#: Minimum number of items for a spread, and maximum number of listed kinds.
_MIN_SPREAD, _MAX_KINDS = 5, 4
_FOOT = (
    "Intervals are 90 % intervals; hollow marks and * denote readings without that guarantee. "
    "Times are local."
)

_Figures = list[tuple[str, str]]


def report(
    item: Annotated[
        str | None, typer.Argument(help="The item.", autocompletion=complete_items)
    ] = None,
    batch: BatchOption = None,
    day: DayOption = None,
    store: StoreOption = None,
    out: Annotated[
        Path | None, opt("--out FILE", "File to write. [default: report-NAME.html]")
    ] = None,
) -> None:
    """Write a web page about an item, a batch or a day.

    The page is self-contained and works offline.

    Example: palpate report A17 --out a17.html
    """
    asked = [name for name in (item, batch, day) if name is not None]
    if len(asked) != 1:
        raise InputError("give exactly one of ITEM, --batch NAME or --day DATE")
    target = out or Path(f"report-{_file_name(asked[0])}.html")
    check_new(target)
    require_plots()
    with open_store(store) as opened:
        if item is not None:
            text = _item_report(read_item_history(opened, item), store=opened.name)
        elif batch is not None:
            pages = read_item_histories(opened, find_batch(opened, batch))
            text = _group_report(f"Batch {batch}", pages, store=opened.name, day=None)
        else:
            date_, since, until = parse_day(asked[0])
            names = dict.fromkeys(one.item_id for one in opened.grasps(since=since, until=until))
            if not names:
                raise InputError(f"{opened.name}: no grasps on {date_}")
            found = read_item_histories(opened, opened.find_items(list(names)))
            pages = tuple(page.select_period(since, until) for page in found)
            title = f"{date_:%A}, {date_.day} {date_:%B %Y}"
            text = _group_report(title, pages, store=opened.name, day=date_)
    with atomic_path(target) as partial:
        partial.write_text(text, encoding="utf-8")
    print_message(f"Written: {target}")


def _file_name(name: str) -> str:
    """Return a file name that is unique to a name: `A/1` and `A 1` differ."""
    plain = re.sub(r"[^\w.-]+", "-", name).strip("-.")
    if plain == name:
        return plain
    return f"{plain or 'item'}-{zlib.crc32(name.encode()):08x}"


def _item_report(page: ItemHistory, *, store: str) -> str:
    """Return the HTML report of one item: latest values, history, verdicts and grasps."""
    item, count = page.item, len(page.grasps)
    chips = [*filter(None, (item.kind, item.batch and f"batch {item.batch}", item.label))]
    if item.first_seen is not None:
        chips.append(f"first seen {format_time(item.first_seen)}")
    chips.append(f"{count} grasp{'s' * (count != 1)}")
    if page.firmness_rank is not None:
        chips.append(page.firmness_rank.text)
    body: list[Part] = [_item_tiles(page)]
    figures = {
        caption: history_figure(page, name, label=f"{caption.lower()} ({unit})")
        for name, caption, unit, _ in _QUANTITIES[:4]
        if page.latest_value(name) is not None
    }
    if (pixels := pixels_figure(page.grasps)) is not None:
        figures["Change of each pixel at the answer, %, by side"] = pixels
    if figures:
        body.append(_inline_figures(figures))
    if page.verdicts:
        verdicts = list(verdict_rows(reversed(page.verdicts[-_MAX_ROWS:])))
        body.append(PageTable("Verdicts", ("when", *VERDICT_COLUMNS), verdicts))
    if page.grasps:
        rows = [_grasp_row(grasp) for grasp in reversed(page.grasps[-_MAX_ROWS:])]
        caption = f"Grasps (the last {_MAX_ROWS} of {count})" if count > _MAX_ROWS else "Grasps"
        quantities = [f">{name.lower()}, {unit}" for _, name, unit, _ in _QUANTITIES]
        body.append(PageTable(caption, ["taken", "outcome", "rig", ">side", *quantities], rows))
    return render_page(
        title=item.item_id,
        chips=chips,
        simulated=page.is_simulated,
        body=body,
        foot=f"From the {store}. {_FOOT}",
    )


def _item_tiles(page: ItemHistory) -> dict[str, tuple[str, str, str]]:
    tiles = {}
    for name, caption, unit, digits in _QUANTITIES[:4]:
        measured = page.latest(name)
        if measured is not None:
            low, high = measured.low, measured.high
            ends = f"{_format_digits(low, digits)} to {_format_digits(high, digits)}"
            if not measured.has_value:
                ends = ""
            tiles[caption] = (_number(measured, digits), unit, ends)
    for about in About:
        verdict = page.latest_verdict(about)
        if verdict is not None:
            known = verdict.probability is not None
            below = f"probability {format_percent(verdict.probability)}" if known else ""
            if verdict.source is Source.PERSON:
                below = "given by a person"
            tiles[str(about).capitalize()] = (verdict.text, "", below)
    return tiles


def _grasp_row(grasp: Grasp) -> list[str]:
    return [
        format_time(grasp.taken_at),
        str(grasp.outcome).replace("_", " "),
        grasp.rig,
        "-" if grasp.angle_deg is None else f"{grasp.angle_deg:g}°",
        *(_number(grasp.measurements.get(name), digits) for name, _, _, digits in _QUANTITIES),
    ]


def _number(measured: Measurement | None, digits: int) -> str:
    """Format a measurement, with * if its status is not `ok`."""
    if measured is None:
        return "-"
    if measured.value is None:
        return measured.text(digits=digits)
    return f"{_format_digits(measured.value, digits)}{'' if measured.status is Status.OK else ' *'}"


def _format_digits(value: float, digits: int) -> str:
    """Format a number with a typographic minus.

    >>> _format_digits(-45.04, 1)
    '\N{MINUS SIGN}45.0'
    """
    return f"{value:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _group_report(title: str, pages: Sequence[ItemHistory], *, store: str, day: date | None) -> str:
    """Return the HTML report of a batch or a day."""
    grasps = [grasp for page in pages for grasp in page.grasps]
    return render_page(
        title=title,
        chips=_summary_labels(pages, grasps),
        simulated=any(grasp.is_simulated for grasp in grasps),
        body=[
            _group_tiles(pages, grasps),
            _group_figures(pages, grasps, day=day),
            _items_table(pages),
        ],
        foot=f"From the {store}. Each item is listed with its last grasp. {_FOOT}",
    )


def _summary_labels(pages: Sequence[ItemHistory], grasps: Sequence[Grasp]) -> list[str]:
    kinds = [kind for kind, _ in Counter(map(kind_of, pages)).most_common()]
    chips = kinds if len(kinds) <= _MAX_KINDS else [f"{len(kinds)} kinds"]
    if grasps:
        first, last = (format_time(end(grasp.taken_at for grasp in grasps)) for end in (min, max))
        day, _, clock = last.partition(" ")
        until = clock if first.startswith(day) else last
        chips.append(first if first == last else f"{first} to {until}")
    return chips


def _group_tiles(
    pages: Sequence[ItemHistory], grasps: Sequence[Grasp]
) -> dict[str, tuple[str, str, str]]:
    held = sum(grasp.outcome is Outcome.HELD for grasp in grasps)
    below = f"{format_percent(held / len(grasps))} held" if grasps else ""
    bins = [page.latest_verdict(About.BIN) for page in pages]
    counts = {
        "not finished": sum(one is not None and is_provisional(one) for one in bins),
        "without a bin": sum(one is None for one in bins) if any(bins) else 0,
    }
    note = ", ".join(f"{count} {what}" for what, count in counts.items() if count)
    tiles = {"Items": (f"{len(pages)}", "", note), "Grasps": (f"{len(grasps)}", "", below)}
    for name, caption, unit, digits in (*_QUANTITIES[:2], _QUANTITIES[3]):
        values = [measured.middle for page in pages if (measured := page.latest_value(name))]
        if values:
            low, middle, high = (f"{q:.{digits}f}" for q in np.quantile(values, [0.1, 0.5, 0.9]))
            below = f"8 in 10: {low} to {high}" if len(values) >= _MIN_SPREAD else ""
            tiles[f"Median {caption.lower()}"] = (middle, unit, below)
    bruised = _count_verdicts(pages, About.BRUISE)
    if bruised:
        text, many = bruised.most_common(1)[0]
        tiles["Bruise"] = (f"{many}", text, f"of {bruised.total()} examined")
    return tiles


def _count_verdicts(pages: Sequence[ItemHistory], about: About) -> Counter[str]:
    return Counter(one.text for page in pages if (one := page.latest_verdict(about)))


def _count_bins(pages: Sequence[ItemHistory]) -> Counter[str]:
    """Count the items by bin, as the lot on the operator's page: without provisional bins."""
    last = (page.latest_verdict(About.BIN) for page in pages)
    return Counter(one.text for one in last if one is not None and not is_provisional(one))


def _latest_text(page: ItemHistory, about: About) -> str:
    """Return an item's latest verdict; a dash without one."""
    verdict = page.latest_verdict(about)
    if verdict is None:
        return "-"
    return f"{verdict.text}, provisional" if is_provisional(verdict) else verdict.text


def _stage_ranks(pages: Sequence[ItemHistory]) -> dict[str, int]:
    """Return the rank of each ripeness stage, firmest first."""
    verdicts = (one for page in pages for one in page.verdicts if one.about is About.RIPENESS)
    judged = (one.details.get("probabilities") for one in verdicts)
    found = [stage for one in judged if isinstance(one, Mapping) for stage in one]
    return {stage: place for place, stage in enumerate(dict.fromkeys(found or STAGES))}


def _days_to_ripe(page: ItemHistory) -> str:
    """Format the days to ripe from an item's latest verdict; a dash if unknown."""
    verdict = page.latest_verdict(About.RIPENESS)
    details = {} if verdict is None else verdict.details
    ends = [details.get(f"days_to_ripe{end}") for end in ("", "_low", "_high")]
    value, low, high = (float(end) if isinstance(end, int | float) else None for end in ends)
    if value is None or low is None or high is None:
        return "-"
    return Days(value=value, low=low, high=high).text


def _inline_figures(figures: Mapping[str, Figure | None]) -> _Figures:
    return [
        (caption, inline_svg(figure, label=caption))
        for caption, figure in figures.items()
        if figure is not None
    ]


def _group_figures(
    pages: Sequence[ItemHistory], grasps: Sequence[Grasp], *, day: date | None
) -> _Figures:
    figures: dict[str, Figure | None] = {}
    if day is None:
        figures["Softening: stiffness of each item over its days"] = softening_figure(pages)
    else:
        figures["Grasps over the day"] = hours_figure(grasps)
    figures["Size and stiffness, by kind"] = size_stiffness_figure(pages)
    if stages := _count_verdicts(pages, About.RIPENESS):
        order = _stage_ranks(pages)
        firmest_first = sorted(stages.items(), key=lambda one: order.get(one[0], len(order)))
        figures["Ripeness"] = counts_figure(firmest_first[:8])
    if bins := _count_bins(pages):
        figures["Bins"] = counts_figure(bins.most_common(8))
    return _inline_figures(figures)


def _items_table(pages: Sequence[ItemHistory]) -> PageTable:
    # Only subjects with verdicts get a column.
    abouts = [
        about
        for about in (About.RIPENESS, About.BRUISE, About.BIN)
        if any(page.latest_verdict(about) for page in pages)
    ]
    is_ripening = any(_days_to_ripe(page) != "-" for page in pages)
    rows = [
        [
            page.item.item_id,
            kind_of(page),
            format_time(page.grasps[-1].taken_at) if page.grasps else "-",
            f"{len(page.grasps)}",
            _number(page.latest("size_mm"), 1),
            _number(page.latest("firmness"), 0),
            _number(page.latest("stiffness_n_per_mm"), 2),
            *(_latest_text(page, about) for about in abouts),
            *([_days_to_ripe(page)] if is_ripening else []),
        ]
        for page in pages[:_MAX_ITEMS]
    ]
    more = len(pages) > _MAX_ITEMS
    caption = f"Items (the first {_MAX_ITEMS} of {len(pages)})" if more else "Items"
    columns = [
        "item",
        "kind",
        "last grasp",
        ">grasps",
        ">size, mm",
        ">firmness",
        ">stiffness, N/mm",
    ]
    columns += [*map(str, abouts), *(["days to ripe"] if is_ripening else [])]
    return PageTable(caption, columns, rows)
