"""The report of one item: what it is like now, how it got there, and the verdicts on it."""

from __future__ import annotations

from datetime import datetime

from palpate.commands.report_html import Tile, figures, html_page, table, tiles
from palpate.estimate.measurement import Measurement
from palpate.plots.inline_svg import inline_svg
from palpate.plots.item_history import history_figure, pixels_figure
from palpate.produce.records import About, Grasp, Source, Verdict
from palpate.produce.store.item_history import ItemHistory
from palpate.settling.result import Status

#: Name, caption, axis, unit in text, digits.
QUANTITIES = (
    ("firmness", "Firmness", "firmness (0 to 100)", "of 100", 0),
    ("stiffness_n_per_mm", "Stiffness", "stiffness (N/mm)", "N/mm", 2),
    ("settled_percent", "Settled change", "settled change (%)", "%", 1),
    ("size_mm", "Size", "size (mm)", "mm", 1),
    ("force_n", "Grip force", "grip force (N)", "N", 2),
)
#: In this many grasps and verdicts a reader still finds something.
_MOST_ROWS = 100


def item_report(page: ItemHistory, *, store: str) -> str:
    """Return the report of an item of a store as HTML; times are of this machine's time zone."""
    item = page.item
    chips = [*filter(None, (item.kind, item.batch and f"batch {item.batch}", item.label))]
    if item.first_seen is not None:
        chips.append(f"first seen {when(item.first_seen)}")
    chips.append(f"{len(page.grasps)} grasp{'s' if len(page.grasps) != 1 else ''}")
    body = [tiles(_tiles(page))]
    if shown := _figures(page):
        body.append(figures(shown))
    if page.verdicts:
        body.append(_verdicts(page))
    if page.grasps:
        body.append(_grasps(page))
    return html_page(
        title=item.item_id,
        chips=chips,
        simulated=page.simulated,
        body=body,
        foot=f"From the {store}. Intervals are at level 0.9; hollow marks and * are readings that "
        "promise less than that. Times are local.",
    )


def verdict_tile(verdict: Verdict) -> Tile:
    """Return the verdict, large."""
    below = "given by a person"
    if verdict.source is Source.PALPATE:
        below = "" if verdict.probability is None else f"{100 * verdict.probability:.0f} % sure"
    return Tile(name=str(verdict.about).capitalize(), value=verdict.text, below=below)


def when(moment: datetime) -> str:
    """Return a time as people write it."""
    return moment.astimezone().strftime("%Y-%m-%d %H:%M")


def number(measured: Measurement | None, digits: int) -> str:
    """Return a value, marked where its interval does not hold its full promise."""
    if measured is None:
        return "-"
    return f"{fixed(measured.middle, digits)}{'' if measured.status is Status.OK else ' *'}"


def fixed(value: float, digits: int) -> str:
    """Return a number with a minus that is no hyphen.

    >>> fixed(-45.04, 1)
    '\N{MINUS SIGN}45.0'
    """
    return f"{value:.{digits}f}".replace("-", "\N{MINUS SIGN}")


def _tiles(page: ItemHistory) -> list[Tile]:
    shown = []
    for name, caption, _, unit, digits in QUANTITIES[:4]:
        measured = page.latest(name)
        if measured is not None:
            ends = f"{fixed(measured.low, digits)} to {fixed(measured.high, digits)}"
            value = number(measured, digits)
            shown.append(Tile(name=caption, value=value, unit=unit, below=ends))
    verdicts = (page.latest_verdict(about) for about in About)
    return [*shown, *(verdict_tile(verdict) for verdict in verdicts if verdict is not None)]


def _figures(page: ItemHistory) -> list[tuple[str, str]]:
    shown = []
    for name, caption, label, _, _ in QUANTITIES[:4]:
        if page.latest(name) is not None:
            figure = history_figure(page, name, label=label)
            shown.append((caption, inline_svg(figure, label=f"{caption} over time")))
    pixels = pixels_figure(page.grasps)
    if pixels is not None:
        caption = "Change of each pixel at the answer, %, by side"
        shown.append((caption, inline_svg(pixels, label=caption)))
    return shown


def _verdicts(page: ItemHistory) -> str:
    rows = [
        (
            when(one.given_at),
            str(one.about),
            one.text,
            "-" if one.probability is None else f"{100 * one.probability:.0f} %",
            one.explanation or ("given by a person" if one.source is Source.PERSON else ""),
        )
        for one in reversed(page.verdicts[-_MOST_ROWS:])
    ]
    return table("Verdicts", ["when", "about", "verdict", ">sure", "why"], rows)


def _grasps(page: ItemHistory) -> str:
    columns = ["taken", "outcome", "rig", ">side"]
    columns += [f">{caption.lower()}, {unit}" for _, caption, _, unit, _ in QUANTITIES]
    rows = [_row(grasp) for grasp in reversed(page.grasps[-_MOST_ROWS:])]
    more = len(page.grasps) - len(rows)
    caption = f"Grasps (the last {len(rows)} of {len(page.grasps)})" if more else "Grasps"
    return table(caption, columns, rows)


def _row(grasp: Grasp) -> list[str]:
    return [
        when(grasp.taken_at),
        str(grasp.outcome).replace("_", " "),
        grasp.rig,
        "-" if grasp.angle_deg is None else f"{grasp.angle_deg:g}°",
        *(number(grasp.measurements.get(name), digits) for name, _, _, _, digits in QUANTITIES),
    ]
