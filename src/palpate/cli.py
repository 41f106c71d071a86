"""The `palpate` command: a table of verbs."""

from __future__ import annotations

import importlib
import sys
from io import TextIOWrapper
from typing import Annotated

import typer

import palpate
from palpate.commands.help_text import help_text
from palpate.commands.outcome import run
from palpate.commands.steps import SETTINGS
from palpate.errors import InputError

#: Heading of the help -> its verbs. Each is a function of that name in a module of that name under
#: `palpate.commands`.
GROUPS: dict[str, tuple[str, ...]] = {
    "Measure": ("grasp", "live", "serve", "record"),
    "Recordings": ("settle", "inspect", "replay", "export", "archive"),
    "Set up": ("demo", "init", "ports", "flash", "doctor", "calibrate", "pattern"),
    "Produce": ("items", "report", "ripeness", "bruise", "sort", "qualify"),
    "Research": ("study", "bench"),
}
#: Verbs of version 0.1 that are options now.
REMOVED = {
    "recover": "palpate inspect FILE --recover FILE",
    "identify": "palpate sort --identify ITEM",
}
VERBS = tuple(verb for verbs in GROUPS.values() for verb in verbs)


def build_app() -> typer.Typer:
    """Assemble the command from its verbs."""
    app = typer.Typer(
        name="palpate",
        help="Examine produce by touch: force, stiffness, size and ripeness from a cheap "
        "resistive pressure sensor on any gripper.",
        no_args_is_help=True,
        pretty_exceptions_enable=False,
    )

    @app.callback()
    def root(
        version: Annotated[
            bool, typer.Option("--version", help="Print the version.", callback=_version)
        ] = False,
    ) -> None:
        pass

    for heading, verbs in GROUPS.items():
        for verb in verbs:
            module = importlib.import_module(f"palpate.commands.{verb}")
            function, settings = getattr(module, verb), getattr(module, "SETTINGS", {})
            text = help_text(function)
            app.command(name=verb, help=text, rich_help_panel=heading, **settings)(function)
    for verb in REMOVED:
        app.command(name=verb, hidden=True, **SETTINGS)(_refuse_removed)
    return app


def _refuse_removed(context: typer.Context) -> None:
    raise InputError(f"{context.info_name}: use `{REMOVED[str(context.info_name)]}`")


def _version(wanted: bool) -> None:
    if wanted:
        print(f"palpate {palpate.__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point of the `palpate` script."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            # A terminal of another encoding shows a question mark for a sign that it lacks.
            stream.reconfigure(errors="replace")
    sys.exit(run(build_app(), sys.argv[1:], name="palpate"))
