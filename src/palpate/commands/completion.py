"""Completion after <Tab> in the shell, for names that palpate knows.

A completion must be quick and never fail: what can't be listed is not offered.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import typer

#: Items offered at most: a shell lists them all at once.
_MOST_ITEMS = 200


def objects(incomplete: str) -> list[str]:
    """Return the simulated objects."""
    from palpate.twin.objects import OBJECTS

    return _matching(OBJECTS, incomplete)


def rigs(incomplete: str) -> list[str]:
    """Return the rigs that have a name, and the rig files of the folder."""
    from palpate.rig import rig_names

    files = sorted(str(path) for path in Path().glob("*.toml"))
    return _matching([*rig_names(), *files], incomplete)


def methods(incomplete: str) -> list[str]:
    """Return the predictors of the settled value."""
    from palpate.settling.predict import METHODS

    return _matching(METHODS, incomplete)


def studies(incomplete: str) -> list[str]:
    """Return the studies that are installed."""
    from palpate.commands.research import catalogue
    from palpate.commands.study import GROUP

    return _matching(sorted(catalogue(GROUP)), incomplete)


def benchmarks(incomplete: str) -> list[str]:
    """Return the benchmarks that are installed."""
    from palpate.commands.bench import GROUP
    from palpate.commands.research import catalogue

    return _matching(sorted(catalogue(GROUP)), incomplete)


def steps(incomplete: str) -> list[str]:
    """Return the steps of a calibration."""
    from palpate.commands.calibrate import STEPS

    return _matching(STEPS, incomplete)


def archive_steps(incomplete: str) -> list[str]:
    """Return what can be done with an archive."""
    from palpate.commands.archive import STEPS

    return _matching(STEPS, incomplete)


def demos(incomplete: str) -> list[str]:
    """Return the demonstrations."""
    from palpate.commands.demo import NAMES

    return _matching(NAMES, incomplete)


def items(context: typer.Context, incomplete: str) -> list[str]:
    """Return the items of the store that the command line names, or of the usual one."""
    from palpate.errors import PalpateError
    from palpate.produce.store import Store

    try:
        with Store.open(context.params.get("store"), create=False) as store:
            known = [item.item_id for item in store.items()]
    except PalpateError:
        return []
    return _matching(known, incomplete)[:_MOST_ITEMS]


def _matching(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]
