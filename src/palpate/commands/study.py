"""`palpate study NAME`: regenerate one table or figure, of the paper or of ours."""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import typer

from palpate.commands import completion
from palpate.commands.options import DpiOption, QuietOption
from palpate.commands.packages import STUDIES
from palpate.commands.steps import SETTINGS, run_named
from palpate.errors import InputError
from palpate.plots.style import EVERY_FORMAT, FigureFiles, figure_files

__all__ = ["SETTINGS", "study"]

FigureFormat: TypeAlias = Literal["pdf", "svg", "png"]


def study(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(help="Which study; `--list` names them.", autocompletion=completion.studies),
    ] = None,
    list_studies: Annotated[bool, typer.Option("--list", help="List the studies.")] = False,
    figure_format: Annotated[
        FigureFormat | None,
        typer.Option("--format", help="With --out: figures in this format alone."),
    ] = None,
    dpi: DpiOption = None,
    quiet: QuietOption = False,
) -> None:
    """Regenerate a table or figure next to the published one. Example: palpate study table1."""
    with figure_files(_files(figure_format, dpi, arguments=context.args)):
        run_named(
            name,
            offer=STUDIES,
            noun="study",
            options="[--json] [--out DIR [--format F] [--dpi N]]",
            listing=list_studies,
            quiet=quiet,
            context=context,
        )


def _files(
    figure_format: FigureFormat | None, dpi: int | None, *, arguments: list[str]
) -> FigureFiles:
    """Return the files of each figure; refuse, before the work, what no file would show."""
    if figure_format is None and dpi is None:
        return EVERY_FORMAT
    option = f"--dpi {dpi}" if figure_format is None else f"--format {figure_format}"
    if not any(one == "--out" or one.startswith("--out=") for one in arguments):
        raise InputError(
            f"{option}: it is for the figures in --out DIR; give that, or leave it out"
        )
    if figure_format is None:
        return FigureFiles(dpi=dpi)
    if dpi is not None and figure_format != "png":
        raise InputError(f"--dpi {dpi}: only png has dots; {figure_format} is sharp at any size")
    return FigureFiles(endings=(f".{figure_format}",), dpi=dpi)
