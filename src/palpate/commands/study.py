"""`palpate study NAME`: regenerate one table or figure, of the paper or of ours."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.options import QuietOption
from palpate.commands.packages import STUDIES
from palpate.commands.steps import SETTINGS, run_named

__all__ = ["SETTINGS", "study"]


def study(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(help="Which study; `--list` names them.", autocompletion=completion.studies),
    ] = None,
    list_studies: Annotated[bool, typer.Option("--list", help="List the studies.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Regenerate a table or figure next to the published one. Example: palpate study table1."""
    run_named(
        name,
        offer=STUDIES,
        noun="study",
        options="[--json] [--out DIR]",
        listing=list_studies,
        quiet=quiet,
        context=context,
    )
