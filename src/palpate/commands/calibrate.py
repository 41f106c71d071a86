"""`palpate calibrate WHAT`: make or renew a part of the calibration file."""

from __future__ import annotations

import importlib
from typing import Annotated, Any

import typer

from palpate.commands import completion
from palpate.commands.help_text import help_text, listed
from palpate.commands.outcome import run
from palpate.errors import InputError

#: Step -> (module under `palpate.commands`, what it does). Each module holds a function `command`.
STEPS: dict[str, tuple[str, str]] = {
    "rest": ("calibrate_rest", "What each pixel reads with nothing on it"),
    "force": ("calibrate_force", "Newtons: a load cell, or dead weights, up and down"),
    "compliance": ("calibrate_compliance", "How far pads, fingers and servo give way"),
    "cell": ("calibrate_cell", "What a count of the board's load cell weighs, by a known weight"),
    "damage": ("calibrate_damage", "What produce bears, from closings until rupture"),
    "settling": ("calibrate_settling", "Holds for `settle --learn-from`, from recorded grasps"),
}

#: The step's own options are parsed by the step.
SETTINGS: dict[str, Any] = {
    "context_settings": {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
}


def calibrate(
    context: typer.Context,
    step: Annotated[
        str | None, typer.Argument(help="Which step.", autocompletion=completion.steps)
    ] = None,
) -> None:
    """Make or renew a part of the calibration file. Example: palpate calibrate rest"""
    if step in (None, "--help"):
        print("usage: palpate calibrate STEP [--help] [options]\n")
        print(listed({known: summary for known, (_, summary) in STEPS.items()}))
        print("\nExample: palpate calibrate rest --rig rig.toml")
        return
    if step not in STEPS:
        raise InputError(f"no calibration step {step!r}; there are: {', '.join(STEPS)}")
    # Loaded by name: a step must not pay for the others.
    module = importlib.import_module(f"palpate.commands.{STEPS[step][0]}")
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command(help=help_text(module.command))(module.command)
    status = run(app, context.args, name=f"palpate calibrate {step}")
    if status:
        raise typer.Exit(status)
