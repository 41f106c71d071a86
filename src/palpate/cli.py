"""The `palpate` command: a table of verbs."""

from __future__ import annotations

import importlib
import sys
from typing import Annotated

import typer

import palpate
from palpate.commands.help_text import help_text
from palpate.commands.outcome import run
from palpate.commands.plain_signs import print_anything

#: Verb -> module under `palpate.commands` that holds a function of that name.
VERBS = (
    "grasp",
    "settle",
    "record",
    "inspect",
    "replay",
    "export",
    "recover",
    "ports",
    "study",
    "bench",
    "doctor",
    "live",
    "serve",
    "calibrate",
    "flash",
    "init",
    "pattern",
    "items",
    "ripeness",
    "report",
    "bruise",
    "identify",
    "sort",
)


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
            bool, typer.Option("--version", help="Say which version this is.", callback=_version)
        ] = False,
    ) -> None:
        pass

    for verb in VERBS:
        module = importlib.import_module(f"palpate.commands.{verb}")
        function, settings = getattr(module, verb), getattr(module, "SETTINGS", {})
        app.command(name=verb, help=help_text(function), **settings)(function)
    return app


def _version(wanted: bool) -> None:
    if wanted:
        print(f"palpate {palpate.__version__}")
        raise typer.Exit


def main() -> None:
    """Entry point of the `palpate` script."""
    print_anything()
    sys.exit(run(build_app(), sys.argv[1:], name="palpate"))
