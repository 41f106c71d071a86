"""`palpate items`: list, show, label or export the items of a store."""

from __future__ import annotations

import getpass
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from datetime import date, datetime, timedelta
from difflib import get_close_matches
from pathlib import Path
from typing import Annotated

import typer
from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from palpate.cli.options import JsonOption, StoreOption, opt
from palpate.cli.output import (
    SIMULATED,
    format_percent,
    format_time,
    print_card,
    print_json,
    print_message,
)
from palpate.errors import InputError, StoreAwayError
from palpate.files import check_new, check_writable
from palpate.grasp.result import Outcome
from palpate.measurement import Measurement
from palpate.terminal_table import make_console, make_table, print_table
from palpate_station.cli.options import BatchOption, DayOption, complete_items
from palpate_station.records import About, Item, Source, Verdict
from palpate_station.sorting.rules_file import read_rules
from palpate_station.store import Store
from palpate_station.store.backup import back_up, restore_backup
from palpate_station.store.item_history import (
    ItemHistory,
    item_document,
    items_document,
    read_item_histories,
    read_item_history,
)
from palpate_station.store.labels import add_label

_SETTABLE = ("kind", "batch", "label")
#: Maximum number of latest grasps and verdicts shown for an item.
_SHOWN = 20
#: Maximum number of names in an error when none is similar.
_NAMED = 5
_MARK = "[yellow]~[/]"
VERDICT_COLUMNS = ("about", "verdict", ">probability", "why")


def items(
    item: Annotated[
        str | None, typer.Argument(help="Show this item.", autocompletion=complete_items)
    ] = None,
    store: StoreOption = None,
    kind: Annotated[str | None, opt("--kind", "Select items of this kind.")] = None,
    batch: BatchOption = None,
    day: DayOption = None,
    limit: Annotated[int, opt("--limit N", "Maximum number of listed items.", min=1)] = 50,
    changes: Annotated[
        list[str] | None, opt("--set NAME=TEXT", "Set kind, batch or label of ITEM.")
    ] = None,
    labels: Annotated[
        list[str] | None,
        opt(
            "--say ABOUT=TEXT",
            "Label ITEM's present ripeness, bruise, identity or bin, as training data.",
        ),
    ] = None,
    by: Annotated[
        str | None, opt("--by NAME", "Who says so. [default: the user of this machine]")
    ] = None,
    rules: Annotated[
        Path | None, opt("--rules FILE", "Rules whose bins --say accepts besides known ones.")
    ] = None,
    export: Annotated[
        Path | None,
        opt(
            "--export FILE",
            "Write the grasps to FILE (.parquet, .csv or .xlsx), and the verdicts to "
            "FILE.verdicts.parquet, or a second file or sheet.",
        ),
    ] = None,
    backup: Annotated[
        Path | None,
        opt("--backup FILE", "Copy the whole store to a new file, also while others write."),
    ] = None,
    restore: Annotated[
        Path | None, opt("--restore FILE", "Create the store from a backup; it must not exist.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List items, show one, label one, or write them to Parquet, CSV or Excel.

    Example: palpate items A17 --set kind=avocado --say ripeness=ripe
    """
    if item is None and (changes or labels):
        raise InputError("--set and --say require an item: palpate items ITEM --set ...")
    if backup is not None or restore is not None:
        _copy_store(store, backup=backup, restore=restore)
        return
    period = None if day is None else parse_day(day)[1:]
    with open_store(store, create=bool(changes or labels)) as opened:
        if item is None:
            _check_selected(opened, kind=kind, batch=batch)
        if item is not None and (changes or labels):
            bins = () if rules is None else read_rules(rules).bins
            giver = by or getpass.getuser()
            _label(opened, item, changes=changes or [], labels=labels or [], bins=bins, by=giver)
        if export is not None:
            _export(opened, export, item=item, kind=kind, batch=batch, period=period)
        elif item is not None:
            page = read_item_history(opened, item)
            print_json(item_document(page)) if as_json else _print_page(page)
        else:
            found = _select_items(opened, kind=kind, batch=batch, period=period, limit=limit + 1)
            pages = read_item_histories(opened, found[:limit])
            if as_json:
                print_json(items_document(pages))
            else:
                _print_items(pages, has_more=len(found) > limit)


def _copy_store(store: str | None, *, backup: Path | None, restore: Path | None) -> None:
    """Back up or restore a store, and print the number of its items."""
    if backup is not None and restore is not None:
        raise InputError("--backup and --restore: give one of them")
    if backup is not None:
        check_new(backup, option="--backup")
        print_message(f"Written: {backup} (items: {back_up(store, backup)})")
    elif restore is not None:
        found, name = restore_backup(store, restore)
        print_message(f"Restored: {name} (items: {found})")


@contextmanager
def open_store(where: str | None, *, create: bool = False) -> Iterator[Store]:
    """Yield the store; report on stderr if a shared store does not answer."""
    with Store.open(where, create=create) as store:
        yield store
        try:
            store.send()
        except StoreAwayError as error:
            store.away = error
        if store.away is not None:
            print_message(
                f"palpate: {store.away}; showing {store.local_name} without data of other stations"
            )


def find_batch(store: Store, batch: str) -> tuple[Item, ...]:
    """Return the items of a batch.

    Raises `InputError` if the batch has no items.
    """
    _check_selected(store, kind=None, batch=batch)
    return store.items_of_batch(batch)


def _check_selected(store: Store, *, kind: str | None, batch: str | None) -> None:
    """Refuse a kind or batch without items, naming similar ones."""
    chosen = {"kind": kind, "batch": batch}
    if kind is batch is None or store.items(kind=kind, batch=batch, limit=1):
        return
    items = store.items()
    for option, name in chosen.items():
        known = sorted({text for one in items if (text := getattr(one, option)) is not None})
        if name is not None and name not in known:
            near = get_close_matches(name, known) or known[:_NAMED]
            hint = f"; did you mean: {', '.join(near)}?" if near else ""
            raise InputError(f"--{option} {name}: {store.name} has no items of this {option}{hint}")
    raise InputError(f"{store.name} has no items of kind {kind} in batch {batch}")


def parse_day(text: str) -> tuple[date, datetime, datetime]:
    """Return a date with its start and end in the local time zone.

    Raises `InputError` if the text is not a date.
    """
    try:
        day = date.fromisoformat(text)
    except ValueError as error:
        raise InputError(f"--day {text}: not a date; use the form 2026-05-01") from error
    start, end = (
        datetime(d.year, d.month, d.day).astimezone() for d in (day, day + timedelta(days=1))
    )
    return day, start, end


def _select_items(
    store: Store,
    *,
    kind: str | None,
    batch: str | None,
    period: tuple[datetime, datetime] | None,
    limit: int,
) -> tuple[Item, ...]:
    if period is None:
        return store.items(kind=kind, batch=batch, limit=limit)
    grasps = store.grasps(kind=kind, batch=batch, since=period[0], until=period[1])
    names = dict.fromkeys(grasp.item_id for grasp in grasps)
    return store.find_items(list(names)[:limit])


def _label(
    store: Store,
    item_id: str,
    *,
    changes: list[str],
    labels: list[str],
    bins: Collection[str],
    by: str,
) -> None:
    settings = dict(_split_setting(text, option="--set", known=_SETTABLE) for text in changes)
    labelled = [
        _split_setting(text, option="--say", known=tuple(map(str, About))) for text in labels
    ]
    for about, text in labelled:
        if about == About.BIN:
            _check_bin(store, text, bins=bins)
    kind, batch, label = map(settings.get, _SETTABLE)
    store.add_item(Item(item_id=item_id, kind=kind, batch=batch, label=label))
    for about, text in labelled:
        add_label(store, item_id, about=About(about), text=text, by=by)


def _check_bin(store: Store, name: str, *, bins: Collection[str]) -> None:
    """Refuse a bin that neither the rules nor the store have; both may have none."""
    known = sorted({*bins, *(one.text for one in store.verdicts(About.BIN))})
    if known and name not in known:
        raise InputError(
            f"--say bin={name}: no such bin; known are {', '.join(known)}. "
            "--rules FILE adds the bins of a rules file"
        )


def _split_setting(text: str, *, option: str, known: tuple[str, ...]) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or name not in known or not value.strip():
        raise InputError(
            f"{option} {text}: must be NAME=TEXT where NAME is one of {', '.join(known)}"
        )
    return name, value.strip()


def _export(
    store: Store,
    path: Path,
    *,
    item: str | None,
    kind: str | None,
    batch: str | None,
    period: tuple[datetime, datetime] | None,
) -> None:
    from palpate_station.store.export import FORMATS, export, find_bins

    if path.suffix not in FORMATS:
        raise InputError(f"--export {path}: the file name must end in {', '.join(FORMATS)}")
    check_writable(path)
    since, until = period or (None, None)
    found: tuple[Item, ...]
    if item is not None:
        found, grasps = (store.item(item),), iter(store.grasps_of(item))
        verdicts = store.verdicts_of(item)
    else:
        found = store.items(kind=kind, batch=batch)
        grasps = store.grasps(kind=kind, batch=batch, since=since, until=until)
        names = {one.item_id for one in found}
        verdicts = tuple(
            verdict
            for about in About
            for verdict in store.verdicts(about, kind=kind)
            if verdict.item_id in names
        )
    # A bin is given after its grasp, perhaps on the next day.
    bins = find_bins(verdicts)
    if item is None and period is not None:
        verdicts = tuple(one for one in verdicts if period[0] <= one.given_at < period[1])
    written = export(path, grasps, verdicts, items=found, bins=bins)
    print_message("Written: " + ", ".join(f"{file} ({rows})" for file, rows in written.items()))


def _print_items(histories: Sequence[ItemHistory], *, has_more: bool) -> None:
    """Print one line per item."""
    console = make_console()
    if not histories:
        console.print("no items; `palpate grasp --item NAME` adds one")
        return
    columns = (
        "item",
        "kind",
        "batch",
        "last grasp",
        ">grasps",
        ">size, mm",
        ">firmness",
        ">N/mm",
        "verdict",
    )
    rows = [
        (
            Text(history.item.item_id, style="bold"),
            Text(history.item.kind or "-"),
            Text(history.item.batch or "-"),
            format_time(history.grasps[-1].taken_at) if history.grasps else "-",
            f"{len(history.grasps)}{f' {_MARK}' if history.is_simulated else '  '}",
            _value(history.latest("size_mm"), 1),
            _value(history.latest("firmness"), 0),
            _value(history.latest("stiffness_n_per_mm"), 2),
            Text(", ".join(v.text for a in About if (v := history.latest_verdict(a))) or "-"),
        )
        for history in histories
    ]
    print_table(columns, rows, console=console)
    if any(history.is_simulated for history in histories):
        console.print(f"{_MARK} simulated on the twin", style="dim")
    if has_more:
        console.print(f"the latest {len(histories)} items; --limit shows more", style="dim")


def _print_page(page: ItemHistory) -> None:
    """Print one item with its grasps and verdicts."""
    item = page.item
    seen = None if item.first_seen is None else f"first seen {format_time(item.first_seen)}"
    rank = None if page.firmness_rank is None else page.firmness_rank.text
    facts = filter(None, (item.kind, item.batch and f"batch {item.batch}", item.label, seen, rank))
    console = make_console()
    parts: list[RenderableType | None] = [Text("  ·  ".join(facts))]
    tables = [_grasps(page)] * bool(page.grasps) + [_verdicts(page)] * bool(page.verdicts)
    for table in tables:
        parts += [None, table]
    if not page.grasps:
        parts.append(
            Text(f"not grasped yet; use palpate grasp --item {item.item_id!r}", style="dim")
        )
    title = Text(item.item_id, style="bold")
    subtitle = SIMULATED if page.is_simulated else None
    print_card(console, *parts, title=title, subtitle=subtitle)


def _grasps(page: ItemHistory) -> Table:
    quantities = {
        "size_mm": (">size\nmm", 1),
        "force_n": (">force\nN", 2),
        "firmness": (">firmness\n", 0),
        "stiffness_n_per_mm": (">stiffness\nN/mm", 2),
        "settled_percent": (">settled\n%", 1),
    }
    heads = [head for head, _ in quantities.values()]
    shown = page.grasps[-_SHOWN:]
    sides = [] if all(grasp.angle_deg is None for grasp in shown) else [">side\n"]
    # The column is shown only if an outcome differs, so that the table fits 80 characters.
    outcomes = ["outcome"] if any(grasp.outcome is not Outcome.HELD for grasp in shown) else []
    table = make_table(("taken", *outcomes, *heads, *sides))
    for grasp in shown:
        side = "-" if grasp.angle_deg is None else f"{grasp.angle_deg:g}°"
        table.add_row(
            format_time(grasp.taken_at),
            *[str(grasp.outcome) for _ in outcomes],
            *(
                _interval_cell(grasp.measurements.get(name), n)
                for name, (_, n) in quantities.items()
            ),
            *[side for _ in sides],
        )
    if len(page.grasps) > _SHOWN:
        table.caption = f"the latest {_SHOWN} of {len(page.grasps)} grasps; --json lists all"
    return table


def _verdicts(page: ItemHistory) -> Table:
    rows = [
        (time, about, Text(text, style="bold"), probability, Text(why))
        for time, about, text, probability, why in verdict_rows(page.verdicts[-_SHOWN:])
    ]
    return make_table(("given", *VERDICT_COLUMNS), rows)


def verdict_rows(verdicts: Iterable[Verdict]) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield a table row for each verdict: the time and `VERDICT_COLUMNS`."""
    for one in verdicts:
        by_person = "given by a person" if one.source is Source.PERSON else ""
        why = one.explanation or by_person
        yield (
            format_time(one.given_at),
            str(one.about),
            one.text,
            format_percent(one.probability),
            why,
        )


def _value(measured: Measurement | None, digits: int) -> str:
    return "-" if measured is None else measured.text(digits=digits)


def _interval_cell(measured: Measurement | None, digits: int) -> str:
    if measured is None:
        return "-"
    if not measured.has_value:
        return measured.text(digits=digits)
    low, high = f"{measured.low:.{digits}f}", f"{measured.high:.{digits}f}"
    return f"[bold]{measured.text(digits=digits)}[/]\n[dim]{low}…{high}[/]"
