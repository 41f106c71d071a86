"""`palpate report`: one item, one batch or one day as a web page with plots."""

from __future__ import annotations

import re
import sys
import zlib
from pathlib import Path
from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.items import day_bounds, opened
from palpate.commands.options import StoreOption
from palpate.errors import InputError


def report(
    item: Annotated[
        str | None, typer.Argument(help="The item.", autocompletion=completion.items)
    ] = None,
    batch: Annotated[str | None, typer.Option(help="Of a batch, instead of an item.")] = None,
    day: Annotated[
        str | None,
        typer.Option(help="Of a day here, instead of an item: 2026-05-01.", metavar="DATE"),
    ] = None,
    store: StoreOption = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File to write. [default: report-NAME.html]", metavar="FILE"),
    ] = None,
) -> None:
    """Write a web page about an item, a batch or a day; it needs no other file and no network.

    Example: palpate report A17 --out a17.html
    """
    from palpate.plots.style import require_plots

    wanted = [name for name in (item, batch, day) if name is not None]
    if len(wanted) != 1:
        raise InputError("name one thing to report on: ITEM, --batch NAME or --day DATE")
    target = out or Path(f"report-{_file_name(wanted[0])}.html")
    if not target.parent.is_dir():
        raise InputError(f"--out {target}: there is no folder {target.parent}; make it first")
    if target.exists():
        raise InputError(f"{target}: exists already and is not overwritten; choose another --out")
    require_plots()
    from palpate.commands.report_item import item_report
    from palpate.commands.report_many import batch_report, day_report
    from palpate.files import atomic_path
    from palpate.produce.store.item_history import item_page, item_pages

    with opened(store) as known:
        if item is not None:
            text = item_report(item_page(known, item), store=known.name)
        elif batch is not None:
            items = known.of_batch(batch)
            if not items:
                raise InputError(f"{known.name}: no items of batch {batch!r}")
            text = batch_report(batch, item_pages(known, items), store=known.name)
        else:
            date, since, until = day_bounds(wanted[0])
            grasps = known.grasps(since=since, until=until)
            names = dict.fromkeys(grasp.item_id for grasp in grasps)
            if not names:
                raise InputError(f"{known.name}: no grasps on {date}")
            pages = item_pages(known, known.items_named(list(names)))
            of_day = [page.within(since, until) for page in pages]
            text = day_report(date, of_day, store=known.name)
    with atomic_path(target) as partial:
        partial.write_text(text, encoding="utf-8")
    print(f"{target}: {len(text) // 1000} kB", file=sys.stderr)


def _file_name(name: str) -> str:
    """Return a name that no other item's report has: `A/1` and `A 1` differ."""
    plain = re.sub(r"[^\w.-]+", "-", name).strip("-.")
    if plain == name:
        return plain
    return f"{plain or 'item'}-{zlib.crc32(name.encode()):08x}"
