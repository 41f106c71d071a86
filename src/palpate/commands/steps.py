"""Verbs of several steps: each is a module of its own, loaded when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from typing import Any

import typer

from palpate.commands.help_text import help_text, listed
from palpate.commands.outcome import run
from palpate.errors import InputError

#: Step -> (module under `palpate.commands`, what it does). Each module holds a function `command`.
Steps = Mapping[str, tuple[str, str]]

#: The step's own options are parsed by the step.
SETTINGS: dict[str, Any] = {
    "context_settings": {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
}


def run_step(
    context: typer.Context, step: str | None, steps: Steps, *, what: str, example: str
) -> None:
    """Run one step of the verb, or list them.

    Raises `InputError` if there is no such step.
    """
    verb = context.info_name
    if step in (None, "--help"):
        print(f"usage: palpate {verb} STEP [--help] [options]\n")
        print(listed({known: summary for known, (_, summary) in steps.items()}))
        print(f"\nExample: {example}")
        return
    if step not in steps:
        raise InputError(f"no {what} {step!r}; there are: {', '.join(steps)}")
    run_module(steps[step][0], context.args, name=f"palpate {verb} {step}")


def run_module(module_name: str, arguments: list[str], *, name: str) -> None:
    """Run the command of a module under `palpate.commands`, or of one with a full name."""
    # Loaded by name: none must pay for the others.
    where = module_name if "." in module_name else f"palpate.commands.{module_name}"
    module = importlib.import_module(where)
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command(help=help_text(module.command))(module.command)
    status = run(app, arguments, name=name)
    if status:
        raise typer.Exit(status)
