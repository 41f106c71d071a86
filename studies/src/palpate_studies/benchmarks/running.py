"""The command of a benchmark: measure, print, write the page."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from palpate.commands.options import JsonOption
from palpate.errors import InputError
from palpate_studies.benchmarks.report import report_of
from palpate_studies.catalogue import BENCHMARKS

#: The benchmark that stands for all others.
ALL = "all"


def _page(page: Path | None) -> Path | None:
    """Refuse, before minutes of measuring, a page that could not be written after them."""
    if page is not None:
        if not page.absolute().parent.is_dir():
            raise InputError(f"--page {page}: there is no folder {page.parent}; make it first")
        from palpate.plots.style import require_plots

        require_plots()
    return page


def command_of(name: str) -> Callable[..., None]:
    """Return the command of a benchmark of the catalogue, or of `ALL` of them."""

    def command(
        full: Annotated[
            bool, typer.Option("--full/--quick", help="Full sizes: minutes, and 6 GB of memory.")
        ] = False,
        as_json: JsonOption = False,
        page: Annotated[
            Path | None,
            typer.Option(help="Web page to write.", metavar="FILE", callback=_page),
        ] = None,
    ) -> None:
        names = [one for one in BENCHMARKS if one != ALL] if name == ALL else [name]
        measured = {one: importlib.import_module(BENCHMARKS[one][0]).measure(full) for one in names}
        report_of(measured, full=full).emit(as_json=as_json, out=None)
        if page is not None:
            from palpate_studies.benchmarks.page import write_page

            write_page(page, measured, full=full)
        if any(ratio.missed for one in measured.values() for ratio in one.ratios):
            raise typer.Exit(1)

    command.__doc__ = f"""{BENCHMARKS[name][1]}.

    Each figure is a ratio to a named peer in the same run; the exit status is 1 where one that is
    wanted is missed.

    Example: palpate bench {"" if name == ALL else name + " "}--page bench.html
    """
    return command
