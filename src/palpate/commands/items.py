"""`palpate items`: what the store remembers, as a list, as the page of one item, as a file."""

from __future__ import annotations

import json
import sys
from contextlib import contextmanager
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.commands import completion
from palpate.commands.options import JsonOption, StoreOption
from palpate.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from palpate.produce.records import Item
    from palpate.produce.store import Store
    from palpate.produce.store.item_history import ItemHistory

_SETTABLE = ("kind", "batch", "label")


def items(
    item: Annotated[
        str | None, typer.Argument(help="One item's page.", autocompletion=completion.items)
    ] = None,
    store: StoreOption = None,
    kind: Annotated[str | None, typer.Option(help="Only items of this kind.")] = None,
    batch: Annotated[str | None, typer.Option(help="Only items of this batch.")] = None,
    day: Annotated[
        str | None,
        typer.Option(help="Only items grasped on this day, here: 2026-05-01.", metavar="DATE"),
    ] = None,
    limit: Annotated[int, typer.Option(help="List at most this many.", min=1)] = 50,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", help="Set kind, batch or label of ITEM.", metavar="NAME=TEXT"),
    ] = None,
    labels: Annotated[
        list[str] | None,
        typer.Option(
            "--say",
            help="Record what ITEM is today: ripeness, bruise, identity or bin. palpate learns "
            "from it.",
            metavar="ABOUT=TEXT",
        ),
    ] = None,
    export: Annotated[
        Path | None,
        typer.Option(
            help="Write the grasps to FILE.parquet, and the verdicts to FILE.verdicts.parquet.",
            metavar="FILE",
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """List items, show one, label one, or write them to Parquet.

    Example: palpate items A17 --set kind=avocado --say ripeness=ripe
    """
    if item is None and (changes or labels):
        raise InputError("--set and --say are about one item: palpate items ITEM --set ...")
    from palpate.produce.store.item_history import item_document, items_document

    with opened(store, create=bool(changes or labels)) as known:
        if item is not None and (changes or labels):
            _label(known, item, changes=changes or [], labels=labels or [])
        pages, more = _find(known, item=item, kind=kind, batch=batch, day=day, limit=limit)
        if export is not None:
            _export(known, export, item=item, kind=kind, batch=batch, day=day)
        elif as_json:
            document = items_document(pages) if item is None else item_document(pages[0])
            print(json.dumps(document, allow_nan=False, indent=1))
        else:
            from palpate.commands.items_tables import print_list, print_page

            if item is not None:
                print_page(pages[0])
            else:
                print_list(pages, more=more)


@contextmanager
def opened(where: str | None, *, create: bool = False) -> Iterator[Store]:
    """Yield the store; a line on stderr says if a shared one did not answer."""
    from palpate.errors import StoreAwayError
    from palpate.produce.store import Store

    with Store.open(where, create=create) as store:
        if store.note:
            print(f"palpate: {store.note}", file=sys.stderr)
        yield store
        try:
            store.send()
        except StoreAwayError as error:
            store.away = error
        if store.away is not None:
            print(
                f"palpate: {store.away}; this is from {store.local_name}, without other stations",
                file=sys.stderr,
            )


def day_bounds(text: str) -> tuple[date, datetime, datetime]:
    """Return a day, and its start and end in the time zone of this machine.

    Raises `InputError` if it is no date.
    """
    try:
        day = date.fromisoformat(text)
    except ValueError as error:
        raise InputError(f"--day {text}: not a date; write it as 2026-05-01") from error
    start, end = (
        datetime(d.year, d.month, d.day).astimezone() for d in (day, day + timedelta(days=1))
    )
    return day, start, end


def _find(
    store: Store,
    *,
    item: str | None,
    kind: str | None,
    batch: str | None,
    day: str | None,
    limit: int,
) -> tuple[tuple[ItemHistory, ...], bool]:
    """Return the pages asked for, and whether there are more items than the limit."""
    from palpate.produce.store.item_history import item_page, item_pages

    if item is not None:
        return (item_page(store, item),), False
    if day is None:
        found = store.items(kind=kind, batch=batch, limit=limit + 1)
    else:
        _, since, until = day_bounds(day)
        grasps = store.grasps(kind=kind, batch=batch, since=since, until=until)
        names = dict.fromkeys(grasp.item_id for grasp in grasps)
        found = store.items_named(list(names)[: limit + 1])
    return item_pages(store, found[:limit]), len(found) > limit


def _label(store: Store, item_id: str, *, changes: list[str], labels: list[str]) -> None:
    from palpate.produce.records import About, Item, Source, Verdict

    settings = dict(_pair(text, option="--set", known=_SETTABLE) for text in changes)
    labelled = [_pair(text, option="--say", known=tuple(map(str, About))) for text in labels]
    store.add_item(
        Item(
            item_id=item_id,
            kind=settings.get("kind"),
            batch=settings.get("batch"),
            label=settings.get("label"),
        )
    )
    grasps = store.grasps_of(item_id)
    for about, text in labelled:
        store.add_verdict(
            Verdict(
                item_id=item_id,
                about=About(about),
                text=text,
                given_at=datetime.now(UTC),
                source=Source.PERSON,
                grasp_id=grasps[-1].grasp_id if grasps else None,
            )
        )


def _pair(text: str, *, option: str, known: tuple[str, ...]) -> tuple[str, str]:
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
    day: str | None,
) -> None:
    from palpate.produce.records import About
    from palpate.produce.store.export import export_grasps, export_verdicts, require_parquet

    if path.suffix != ".parquet":
        raise InputError(f"--export {path}: the file must end in .parquet")
    if not path.parent.is_dir():
        raise InputError(f"--export {path}: there is no folder {path.parent}; make it first")
    require_parquet()
    items: tuple[Item, ...]
    if item is not None:
        items, grasps = (store.item(item),), iter(store.grasps_of(item))
        verdicts = store.verdicts_of(item)
    else:
        _, since, until = (None, None, None) if day is None else day_bounds(day)
        items = store.items(kind=kind, batch=batch)
        grasps = store.grasps(kind=kind, batch=batch, since=since, until=until)
        wanted = {one.item_id for one in items}
        verdicts = tuple(
            verdict
            for about in About
            for verdict in store.verdicts(about, kind=kind)
            if verdict.item_id in wanted
            and (since is None or until is None or since <= verdict.given_at < until)
        )
    verdicts_path = path.with_suffix(".verdicts.parquet")
    rows = export_grasps(path, grasps, items=items)
    verdict_rows = export_verdicts(verdicts_path, verdicts)
    print(f"{path}: {rows} grasps; {verdicts_path}: {verdict_rows} verdicts", file=sys.stderr)
