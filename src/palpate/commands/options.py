"""Options that several verbs share, each with one wording."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from palpate.commands import completion

_FILE, _VARIABLE = Path("rig.toml"), "PALPATE_RIG"


def stated_rig() -> str | None:
    """Return the rig of this folder (`rig.toml`) or of the environment (`$PALPATE_RIG`)."""
    if _FILE.is_file():
        return str(_FILE)
    return os.environ.get(_VARIABLE) or None


def _chosen(rig: str) -> str:
    """Return the rig asked for, the stated one, or the twin, whose output always says so."""
    from palpate.rig import DEFAULT_RIG

    return rig or stated_rig() or DEFAULT_RIG


#: Give it the default "": ./rig.toml, then $PALPATE_RIG, then the simulated rig.
RigOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--rig",
        help="A rig file, or a built-in rig. By default ./rig.toml, then $PALPATE_RIG, then "
        "sim-rigid (simulated).",
        metavar="NAME_OR_TOML",
        autocompletion=completion.rigs,
        callback=_chosen,
        show_default=False,
    ),
]

#: Give it the default False.
JsonOption: TypeAlias = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]

#: Give it the default False.
QuietOption: TypeAlias = Annotated[
    bool,
    typer.Option("--quiet", help="No progress bar (nor is there one without a terminal)."),
]

#: Give it the default None.
DpiOption: TypeAlias = Annotated[
    int | None,
    typer.Option(
        "--dpi", help="Dots per inch of a .png plot; 300 by default.", min=30, max=2400, metavar="N"
    ),
]


def _possible(target_force_n: float | None) -> float | None:
    """Refuse a force that no grasp may reach."""
    from palpate.grasp.planning import check_target_force

    check_target_force(target_force_n, name="--target-force-n")
    return target_force_n


#: Give it the default None.
TargetForceOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--target-force-n",
        help="Grip force to reach; a gentle squeeze by default.",
        callback=_possible,
    ),
]

#: Give it the default None.
StoreOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--store",
        help="The store of items: a file, or the URL of a PostgreSQL database. By default "
        "$PALPATE_STORE, then palpate-items.sqlite in this folder.",
        metavar="FILE_OR_URL",
        show_default=False,
    ),
]

#: Give it the default 0.
SeedOption: TypeAlias = Annotated[
    int, typer.Option("--seed", help="Simulated rigs: decides what chance does.", min=0)
]

# Of every verb that reads a sensor: a rig, or a board on a port. Give them the default None.
SensorOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--rig",
        help="Name of a rig, or a rig file.",
        metavar="NAME_OR_TOML",
        autocompletion=completion.rigs,
    ),
]
PortOption: TypeAlias = Annotated[
    str | None, typer.Option(help="Serial port. [default: found by USB id, or by asking]")
]
LayoutOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="Of the board on --port: rigid-2x2, soft-3x2, or rows x columns "
        "such as 4x4. [default: rigid-2x2]"
    ),
]
ReferenceOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its divider's resistor. [default: 4700]")
]
RateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its frames per second. [default: 250]")
]
BaudOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Speed of its firmware. [default: 1000000]")
]
