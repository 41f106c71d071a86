"""`palpate study NAME`: regenerate one table or figure, of the paper or of ours."""

from __future__ import annotations

import importlib
from typing import Annotated, Any

import typer

from palpate.commands.help_text import help_text
from palpate.commands.outcome import run
from palpate.errors import InputError

#: Study -> (module under `palpate.studies`, what it shows). Each module holds a function `command`.
STUDIES: dict[str, tuple[str, str]] = {
    "force-ladders": ("force_ladders", "Dead weights on real Velostat, sensors held out"),
    "force-control": ("force_control", "Random things gripped to a force and lifted, simulated"),
    "hybrid": ("hybrid", "Recorded fruit and sheets through the real firmware"),
    "noise": ("noise", "Filters against mains pick-up and motor spikes, on the twin"),
    "pixels": ("pixels", "Number of pixels, and dead ones, on the twin"),
    "presence": ("presence", "Video 3, closing again until something is there, simulated"),
    "presses": ("presses", "Force now on real Velostat under a robot's presses"),
    "ripeness": ("ripeness", "Figure 16, stages and days to ripe of avocados on the twin"),
    "rupture": ("rupture", "When to stop closing on real fruit, before it ruptures"),
    "rupture-limits": ("rupture_limits", "How much of a rupture the curve before it can tell"),
    "realism": ("realism", "The twin's scatter beside real recordings"),
    "bruise": ("bruise", "Table 6 and Figure 17, bruised apples told from sound ones, simulated"),
    "bruise-limits": ("bruise_limits", "How well a bruise could be told without a sheet's scatter"),
    "detection-limit": ("detection_limit", "Weakest force seen and linearity, on the twin"),
    "environment": ("environment", "Figures 1b and 3, climate and suction on the twin"),
    "fatigue": ("fatigue", "Figure 4, 2 500 cycles on the twin, re-zeroed and corrected"),
    "speed": ("speed", "Actuation speed against every predictor, on the twin"),
    "size": ("size", "Figure 14, size of strawberries in 1 mm steps, simulated"),
    "slip": ("slip", "Slip and removal: rates, false alarms, delays, simulated"),
    "springs": ("springs", "Figure 10b, springs on the twin"),
    "table1": ("table1", "Table 1 and Figures 5 and 6, on simulated holds"),
    "table2": ("table2", "Table 2 and Figure 8b, silicone sheets on the twin"),
    "table3": ("table3", "Table 3 and Figure 9, exercise balls on the twin"),
    "table4": ("table4", "Table 4 and Figure 11c on the twin, and why slopes differ"),
    "table5": ("table5", "Table 5: force estimated early, simulated"),
    "stiffness": ("stiffness", "Stiffness in N/mm over two decades, simulated"),
    "staircases": ("staircases", "Force now during staircases of closing and opening, simulated"),
    "settling-limits": ("settling_limits", "How well any predictor could do, real and drawn"),
    "identify": ("identify", "What each item of a mixed crate is, strangers among them, simulated"),
    "sorting": ("sorting", "Purity and items per hour of sorting by rules, simulated"),
    "real-holds": ("real_holds", "Table 1 on real recordings, specimens held out"),
}

#: The study's own options are parsed by the study.
SETTINGS: dict[str, Any] = {
    "context_settings": {
        "allow_extra_args": True,
        "ignore_unknown_options": True,
        "help_option_names": [],
    }
}


def study(
    context: typer.Context,
    name: Annotated[str | None, typer.Argument(help="Which study; `--list` names them.")] = None,
    list_studies: Annotated[bool, typer.Option("--list", help="List the studies.")] = False,
) -> None:
    """Regenerate a table or figure beside the published one. Example: palpate study table1."""
    if list_studies or name in (None, "--help"):
        width = max(map(len, STUDIES), default=0)
        print("usage: palpate study NAME [--help] [--json] [--out DIR]\n")
        for known, (_, summary) in sorted(STUDIES.items()):
            print(f"  {known:<{width}}  {summary}")
        return
    if name not in STUDIES:
        raise InputError(f"no study {name!r}; there are: {', '.join(sorted(STUDIES))}")
    # Loaded by name: other verbs, and other studies, must not pay for it.
    module = importlib.import_module(f"palpate.studies.{STUDIES[name][0]}")
    app = typer.Typer(pretty_exceptions_enable=False, add_completion=False)
    app.command(help=help_text(module.command))(module.command)
    status = run(app, context.args, name=f"palpate study {name}")
    if status:
        raise typer.Exit(status)
