"""The `palpate` command: a table of verbs."""

from __future__ import annotations

import importlib
import sys

import typer

from palpate.commands.outcome import run

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
    def root() -> None:
        pass

    for verb in VERBS:
        module = importlib.import_module(f"palpate.commands.{verb}")
        app.command(name=verb, **getattr(module, "SETTINGS", {}))(getattr(module, verb))
    return app


def main() -> None:
    """Entry point of the `palpate` script."""
    sys.exit(run(build_app(), sys.argv[1:], name="palpate"))
