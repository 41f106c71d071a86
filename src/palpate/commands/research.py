"""Studies and benchmarks: found through entry points, so that the product does not carry them."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Any, NoReturn

from palpate.commands.help_text import listed
from palpate.commands.progress import progress
from palpate.commands.steps import run_module
from palpate.errors import InputError

#: Entry points through which packages offer studies, and benchmarks.
STUDIES, BENCHMARKS = "palpate.studies", "palpate.benchmarks"
#: What an entry point of such a group leads to: name -> (module with a `command`, summary).
Catalogue = dict[str, tuple[str, str]]


def catalogue(group: str) -> Catalogue:
    """Return everything that installed packages offer in a group of entry points."""
    found: Catalogue = {}
    for point in entry_points(group=group):
        found |= point.load()
    return found


def run_named(
    name: str | None,
    *,
    group: str,
    verb: str,
    noun: str,
    options: str,
    listing: bool,
    quiet: bool,
    context: Any,
) -> None:
    """List what a group offers, or run one of it with the rest of the command line."""
    known = catalogue(group)
    if not known:
        _not_installed(verb)
    if listing or name in (None, "--help"):
        print(f"usage: palpate {verb} NAME [--help] {options}\n")
        print(listed({entry: summary for entry, (_, summary) in sorted(known.items())}))
        return
    if name not in known:
        raise InputError(f"no {noun} {name!r}; there are: {', '.join(sorted(known))}")
    asked = {"--json", "--help"} & set(context.args)
    with progress(f"{verb} {name}", quiet=quiet or bool(asked)):
        run_module(known[name][0], context.args, name=f"palpate {verb} {name}")


def _not_installed(verb: str) -> NoReturn:
    raise InputError(
        f"palpate {verb} needs the package palpate-studies; "
        "in a copy of the source: pip install ./studies"
    )
