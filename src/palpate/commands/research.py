"""Studies and benchmarks: listed, and run by name."""

from __future__ import annotations

from typing import Any

from palpate.commands.help_text import listed
from palpate.commands.packages import Offer, needed
from palpate.commands.progress import progress
from palpate.commands.steps import run_module
from palpate.errors import InputError


def run_named(
    name: str | None,
    *,
    offer: Offer,
    noun: str,
    options: str,
    listing: bool,
    quiet: bool,
    context: Any,
) -> None:
    """List what packages offer, or run one of it with the rest of the command line."""
    known, verb = needed(offer), offer.asked
    if listing or name in (None, "--help"):
        print(f"usage: {verb} NAME [--help] {options}\n")
        print(listed({entry: summary for entry, (_, summary) in sorted(known.items())}))
        return
    if name not in known:
        raise InputError(f"no {noun} {name!r}; there are: {', '.join(sorted(known))}")
    asked = {"--json", "--help"} & set(context.args)
    with progress(f"{verb.removeprefix('palpate ')} {name}", quiet=quiet or bool(asked)):
        run_module(known[name][0], context.args, name=f"{verb} {name}")
