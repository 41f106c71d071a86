"""Options that several verbs share, each with one wording."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import typer

from palpate.cli import completion
from palpate.errors import InputError

_FILE, _VARIABLE = Path("rig.toml"), "PALPATE_RIG"


def rig_of_environment() -> str | None:
    """Return the rig of this folder (`rig.toml`) or of the environment (`$PALPATE_RIG`)."""
    if _FILE.is_file():
        return str(_FILE)
    return os.environ.get(_VARIABLE) or None


def board_options(rig: str | None, **options: Any) -> tuple[str | None, dict[str, Any]]:
    """Return the rig, and the options of a board that were given.

    Where nothing at all is given it is ./rig.toml or $PALPATE_RIG.
    Raises `InputError` if something is given that a rig states.
    """
    given = {name: value for name, value in options.items() if value is not None}
    if rig is None and not given:
        rig = rig_of_environment()
    elif rig is not None and given:
        option = next(iter(given)).replace("_", "-")
        raise InputError(f"--{option}: a rig states that itself; leave it out with --rig")
    return rig, given


def _choose_rig(rig: str) -> str:
    """Return the rig asked for, the stated one, or the twin, whose output always says so."""
    from palpate.rig import DEFAULT_RIG

    return rig or rig_of_environment() or DEFAULT_RIG


#: Give it the default "": ./rig.toml, then $PALPATE_RIG, then the simulated rig.
RigOption: TypeAlias = Annotated[
    str,
    typer.Option(
        "--rig",
        help="A rig file, or a built-in rig. By default ./rig.toml, then $PALPATE_RIG, then "
        "sim-rigid (simulated).",
        metavar="NAME_OR_TOML",
        autocompletion=completion.rigs,
        callback=_choose_rig,
        show_default=False,
    ),
]

#: Give it the default False.
JsonOption: TypeAlias = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]

#: Give it the default 20.
HorizonOption: TypeAlias = Annotated[
    float, typer.Option("--horizon", help="Time of the settled value.", metavar="SECONDS")
]

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


def _check_force(target_force_n: float | None) -> float | None:
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
        metavar="NEWTONS",
        callback=_check_force,
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

#: Give them the default None.
BatchOption: TypeAlias = Annotated[
    str | None, typer.Option("--batch", help="Items of this batch.", metavar="NAME")
]
DayOption: TypeAlias = Annotated[
    str | None,
    typer.Option("--day", help="Items grasped on this day, here: 2026-05-01.", metavar="DATE"),
]

#: Give it the default None.
ObjectOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--object",
        help="Simulated rigs: the object between the fingers; by default drawn by the seed.",
        metavar="NAME",
        autocompletion=completion.objects,
    ),
]

#: Give it the default None.
DamageOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--damage",
        help="Stay below the force that such produce withstands: a file of `palpate calibrate "
        "damage`.",
        metavar="FILE",
    ),
]

#: Give it the default 0.
SeedOption: TypeAlias = Annotated[
    int, typer.Option("--seed", help="Simulated rigs: seed of all that is random.", min=0)
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
    str | None,
    typer.Option(help="Serial port. [default: found by USB id, or by asking]", metavar="PORT"),
]
LayoutOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="Of the board on --port: rigid-2x2, soft-3x2, or rows x columns "
        "such as 4x4. [default: rigid-2x2]",
        metavar="LAYOUT",
    ),
]
ReferenceOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its divider's resistor. [default: 4700]", metavar="OHM")
]
RateOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Its frames per second. [default: 250]", metavar="HZ")
]
BaudOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Speed of its firmware. [default: 1000000]", metavar="BAUD")
]

# Of calibrations. Give them the default None.
TemperatureOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Of the room, where known.", metavar="CELSIUS")
]
HumidityOption: TypeAlias = Annotated[
    float | None, typer.Option(help="Of the room, where known.", metavar="PERCENT")
]
CalibrationOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="File to make or renew. By default the rig file's, or calibration.json.",
        metavar="FILE",
    ),
]
