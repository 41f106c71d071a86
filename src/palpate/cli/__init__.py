"""The `palpate` command: a table of verbs, each loaded when it is asked for."""

from __future__ import annotations

import sys
from io import TextIOWrapper
from typing import Annotated, Any

import typer

import palpate
from palpate.cli.lazy_group import HELP, Entry, LazyGroup
from palpate.cli.outcome import run
from palpate.errors import InputError

_STUDIES, _ARCHIVE = ("palpate-studies", "studies"), ("palpate-archive", "archive")
#: Heading of the help -> its verbs -> what they do: the first paragraph of the function of that
#: name in the module of that name under `palpate.cli`.
GROUPS = {
    "Measure": {
        "grasp": "Close on an unknown object, measure size, force and stiffness, and release it.",
        "live": "Show pixels, contact, rate and losses in the terminal.",
        "serve": "Serve the dashboard: pixels, prediction and verdict; grasp, calibrate, replay.",
        "record": "Record a board, or a rig with its gripper.",
    },
    "Recordings": {
        "settle": "Predict what recordings settle to from their first seconds, with the error.",
        "inspect": "Show what a recording holds, and whether it is complete.",
        "replay": "Run a recorded grasp through the controller again.",
        "export": "Write a recording as a table of frames or holds, or grasps for LeRobot.",
        "archive": "Keep grasps, holds and frames as partitioned Parquet, and evaluate them again.",
    },
    "Set up": {
        "demo": "Write simulated files to try palpate on.",
        "init": "Write a rig file.",
        "ports": "List serial ports, likely boards first.",
        "flash": "Write the firmware with avrdude, verify it, and ask the board what it runs.",
        "doctor": "Find faulty and swapped pixels, losses and a wrong resistor.",
        "calibrate": "Make or renew a part of the calibration file.",
        "pattern": "Draw the cut files of a sensor, or of a gripper for a hobby servo.",
    },
    "Produce": {
        "items": "List items, show one, label one, or write them to Parquet.",
        "report": "Write a web page about an item, a batch or a day.",
        "ripeness": "Report how ripe items are and when they will be ripe.",
        "bruise": "Judge whether an item is bruised, side by side, from its last visit.",
        "sort": "Sort items into bins by readable rules, or identify one item.",
        "qualify": "Qualify grasps against a penetrometer, a durometer or a buyer's grades.",
        "teach": "Learn a label from grasps, report the accuracy, and name unlabelled items.",
    },
    "Research": {
        "study": "Regenerate a table or figure next to the published one.",
        "bench": "Measure speed and memory relative to other programs.",
    },
}
_PACKAGES = {"study": _STUDIES, "bench": _STUDIES, "archive": _ARCHIVE}
VERBS = {
    verb: Entry(f"palpate.cli.{verb}:{verb}", summary, heading, _PACKAGES.get(verb))
    for heading, verbs in GROUPS.items()
    for verb, summary in verbs.items()
}
#: Verbs of version 0.1 that are options now.
REMOVED = {
    "recover": "palpate inspect FILE --recover FILE",
    "identify": "palpate sort --identify ITEM",
}


class _Palpate(LazyGroup):
    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        if args[0] in REMOVED:
            raise InputError(f"{args[0]}: use `{REMOVED[args[0]]}`")
        return super().resolve_command(ctx, args)


def build_app() -> LazyGroup:
    """Assemble the command from its verbs."""
    app = typer.Typer(cls=_Palpate, name="palpate", no_args_is_help=True, rich_markup_mode=HELP)

    @app.callback()
    def root(
        version: Annotated[
            bool, typer.Option("--version", help="Print the version.", callback=_version)
        ] = False,
    ) -> None:
        """Examine produce by touch with a cheap resistive pressure sensor on any gripper."""

    group = typer.main.get_command(app)
    assert isinstance(group, LazyGroup)
    group.offer(VERBS)
    return group


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
