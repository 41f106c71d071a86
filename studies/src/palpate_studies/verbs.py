"""`palpate study NAME`: one study of the installed ones."""

from __future__ import annotations

from importlib.metadata import entry_points
from typing import Annotated, Any

import typer

from palpate.cli.lazy_group import Entry, LazyGroup, load_command
from palpate.cli.options import QuietOption
from palpate.cli.output import progress
from palpate.errors import InputError

#: What comes after the name is parsed by the study.
SETTINGS: dict[str, Any] = {
    "context_settings": {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
}


def catalogue() -> dict[str, Entry]:
    """Return the studies that installed packages offer, by name."""
    rows = [row for point in entry_points(group="palpate.studies") for row in point.load().items()]
    return {name: Entry(f"{place}:command", text) for name, (place, text) in sorted(rows)}


def _names(incomplete: str) -> list[str]:
    return [name for name in catalogue() if name.startswith(incomplete)]


def study(
    context: typer.Context,
    name: Annotated[
        str | None,
        typer.Argument(help="Which study; `--list` names them.", autocompletion=_names),
    ] = None,
    listing: Annotated[bool, typer.Option("--list", help="List the studies.")] = False,
    quiet: QuietOption = False,
) -> None:
    """Regenerate a table or figure next to the published one.

    Example: palpate study table1
    """
    known = catalogue()
    if listing or name in (None, "--help"):
        listed = LazyGroup(name="study", help="palpate study NAME [options]", no_args_is_help=True)
        listed.offer(known)
        listed.main(["--help"], prog_name="palpate study", standalone_mode=False)
        return
    if name not in known:
        raise InputError(f"no study {name!r}; there are: {', '.join(known)}")
    with progress(f"study {name}", quiet=quiet or bool({"--json", "--help"} & set(context.args))):
        command = load_command(name, known[name])
        status = command.main(
            context.args, prog_name=f"palpate study {name}", standalone_mode=False
        )
    if status:
        raise typer.Exit(status)
