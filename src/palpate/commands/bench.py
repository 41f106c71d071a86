"""`palpate bench [NAME]`: palpate next to its peers, on this machine."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.options import QuietOption
from palpate.commands.packages import BENCHMARKS
from palpate.commands.steps import SETTINGS, run_named

__all__ = ["SETTINGS", "bench"]

#: The one that runs without a name.
ALL = "all"


def bench(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(
            help="Which; `--list` names them. Default: all.", autocompletion=completion.benchmarks
        ),
    ] = None,
    list_all: Annotated[bool, typer.Option("--list", help="List the benchmarks.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Measure speed and memory, every figure a ratio to a named peer in the same run.

    Example: palpate bench --page bench.html
    """
    # Options of the benchmarks are unknown here: the first one takes the place of a name.
    if name is not None and name.startswith("-") and name != "--help":
        context.args.insert(0, name)
        name = None
    run_named(
        name or ALL,
        offer=BENCHMARKS,
        noun="benchmark",
        options="[--full] [--json] [--page FILE]",
        listing=list_all,
        quiet=quiet,
        context=context,
    )
