"""Command-line options that several verbs of the station share."""

from __future__ import annotations

from typing import Annotated, TypeAlias

import typer

from palpate.cli.options import filter_names, opt

#: Environment variable with the name of this station.
STATION_VARIABLE = "PALPATE_STATION"
#: Maximum number of completions, because a shell lists all of them at once.
_MAX_ITEMS = 200


def complete_items(context: typer.Context, incomplete: str) -> list[str]:
    """Return the item names of the requested or default store."""
    from palpate.errors import PalpateError
    from palpate_station.store import Store

    try:
        with Store.open(context.params.get("store"), create=False) as store:
            known = [item.item_id for item in store.items()]
    except PalpateError:
        return []
    return filter_names(known, incomplete)[:_MAX_ITEMS]


#: Require the default None.
BatchOption: TypeAlias = Annotated[str | None, opt("--batch NAME", "Select items of this batch.")]
DayOption: TypeAlias = Annotated[
    str | None, opt("--day DATE", "Select items grasped on this local date, such as 2026-05-01.")
]

ItemArgument: TypeAlias = Annotated[
    str,
    typer.Argument(
        help="A previously grasped item.", metavar="ITEM", autocompletion=complete_items
    ),
]
