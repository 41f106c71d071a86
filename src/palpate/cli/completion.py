"""Completion after <Tab> in the shell, for names that palpate knows.

A completion must be quick and never fail: names that can't be listed are not offered.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable
from pathlib import Path

import typer

#: Items offered at most: a shell lists them all at once.
_MOST_ITEMS = 200


def _complete_from(module: str, table: str) -> Callable[[str], list[str]]:
    """Return the completion of the names in a table, which is loaded when the shell asks."""

    def complete(incomplete: str) -> list[str]:
        return _filter_names(getattr(importlib.import_module(module), table), incomplete)

    return complete


def _filter_names(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


objects = _complete_from("palpate.twin.objects", "OBJECTS")
methods = _complete_from("palpate.settling.predict", "METHODS")
demos = _complete_from("palpate.cli.demo", "NAMES")


def rigs(incomplete: str) -> list[str]:
    """Return the rigs that have a name, and the rig files of the folder."""
    from palpate.rig import rig_names

    files = sorted(str(path) for path in Path().glob("*.toml"))
    return _filter_names([*rig_names(), *files], incomplete)


def items(context: typer.Context, incomplete: str) -> list[str]:
    """Return the items of the store that the command line names, or of the usual one."""
    from palpate.errors import PalpateError
    from palpate.produce.store import Store

    try:
        with Store.open(context.params.get("store"), create=False) as store:
            known = [item.item_id for item in store.items()]
    except PalpateError:
        return []
    return _filter_names(known, incomplete)[:_MOST_ITEMS]
