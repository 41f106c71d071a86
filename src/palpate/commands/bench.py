"""`palpate bench NAME`: how fast it is on this machine."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.options import QuietOption
from palpate.commands.research import run_named
from palpate.commands.steps import SETTINGS

__all__ = ["SETTINGS", "bench"]

#: Entry points through which packages offer benchmarks.
GROUP = "palpate.benchmarks"


def bench(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(help="Which; `--list` names them.", autocompletion=completion.benchmarks),
    ] = None,
    list_all: Annotated[bool, typer.Option("--list", help="List the benchmarks.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Measure speed, memory and agreement with other libraries.

    Example: palpate bench settling --quick
    """
    run_named(
        name,
        group=GROUP,
        verb="bench",
        noun="benchmark",
        listing=list_all,
        quiet=quiet,
        context=context,
    )
