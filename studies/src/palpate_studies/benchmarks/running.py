"""The command of a benchmark: measure and report."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Annotated

import typer

from palpate.cli.options import JsonOption
from palpate_studies.benchmarks.report import report_of
from palpate_studies.catalogue import BENCHMARKS
from palpate_studies.report import OutOption

#: The benchmark that stands for all others.
ALL = "all"


def command_of(name: str) -> Callable[..., None]:
    """Return the command of a benchmark of the catalogue, or of `ALL` of them."""

    def command(
        full: Annotated[
            bool, typer.Option("--full/--quick", help="Full sizes: minutes, and 6 GB of memory.")
        ] = False,
        as_json: JsonOption = False,
        out: OutOption = None,
    ) -> None:
        names = [one for one in BENCHMARKS if one != ALL] if name == ALL else [name]
        measured = {one: importlib.import_module(BENCHMARKS[one][0]).measure(full) for one in names}
        report_of(measured, full=full).emit(as_json=as_json, out=out)
        if any(ratio.missed for one in measured.values() for ratio in one.ratios):
            raise typer.Exit(1)

    command.__doc__ = f"""{BENCHMARKS[name][1]}.

    Each figure is a ratio to a named peer in the same run; the exit status is 1 where one that is
    wanted is missed.

    Example: palpate bench {"" if name == ALL else name + " "}--json
    """
    return command
