"""Verbs of several steps, studies and benchmarks: each is loaded when it is asked for."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from typing import Any

import typer

from palpate.commands.help_text import help_text, listed
from palpate.commands.outcome import run
from palpate.commands.packages import Offer, needed
from palpate.commands.progress import progress
from palpate.errors import InputError

#: Step -> (where it is, what it does): a module under `palpate.commands`, and after a colon the
#: function in it; `command` without one.
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


def run_named(
    name: str | None,
    *,
    offer: Offer,
    noun: str,
    options: str,
    listing: bool,
    quiet: bool,
    context: Any,
) -> None:
    """List what packages offer, or run one of it with the rest of the command line."""
    known, verb = needed(offer), offer.asked
    if listing or name in (None, "--help"):
        print(f"usage: {verb} NAME [--help] {options}\n")
        print(listed({entry: summary for entry, (_, summary) in sorted(known.items())}))
        return
    if name not in known:
        raise InputError(f"no {noun} {name!r}; there are: {', '.join(sorted(known))}")
    asked = {"--json", "--help"} & set(context.args)
    with progress(f"{verb.removeprefix('palpate ')} {name}", quiet=quiet or bool(asked)):
        run_module(known[name][0], context.args, name=f"{verb} {name}")


def run_module(place: str, arguments: list[str], *, name: str) -> None:
    """Run a step under `palpate.commands`, or the `command` of a module with a full name."""
    function = function_at(place)
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command(help=help_text(function))(function)
    status = run(app, arguments, name=name)
    if status:
        raise typer.Exit(status)


def function_at(place: str) -> Callable[..., None]:
    """Load what a step's place names: none must pay for the others."""
    module_name, _, function_name = place.partition(":")
    where = module_name if "." in module_name else f"palpate.commands.{module_name}"
    function: Callable[..., None] = getattr(
        importlib.import_module(where), function_name or "command"
    )
    return function
