"""`palpate calibrate WHAT`: make or renew a part of the calibration file."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.steps import SETTINGS, Steps, run_step

__all__ = ["SETTINGS", "STEPS", "calibrate"]

STEPS: Steps = {
    "rest": ("calibrate_rest", "What each pixel reads with nothing on it"),
    "force": ("calibrate_force", "Newtons: a load cell, or dead weights, up and down"),
    "compliance": ("calibrate_compliance", "How far pads, fingers and servo give way"),
    "cell": ("calibrate_cell", "What a count of the board's load cell weighs, by a known weight"),
    "damage": ("calibrate_damage", "What produce bears, from closings until rupture"),
    "settling": ("calibrate_settling", "Holds for `settle --learn-from`, from recorded grasps"),
}


def calibrate(
    context: typer.Context,
    step: Annotated[
        str | None, typer.Argument(help="Which step.", autocompletion=completion.steps)
    ] = None,
) -> None:
    """Make or renew a part of the calibration file. Example: palpate calibrate rest"""
    run_step(
        context,
        step,
        STEPS,
        what="calibration step",
        example="palpate calibrate rest --rig rig.toml",
    )
