"""Options that several verbs share, each with one wording."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.grasp.paper import Paper


#: Items offered at most: a shell lists them all at once.
_MOST_ITEMS = 200


def _complete_from(module: str, table: str) -> Callable[[str], list[str]]:
    """Return the completion of the names in a table, which is loaded when the shell asks."""

    def complete(incomplete: str) -> list[str]:
        return _filter_names(getattr(importlib.import_module(module), table), incomplete)

    return complete


def _filter_names(names: Iterable[str], incomplete: str) -> list[str]:
    return [name for name in names if name.startswith(incomplete)]


complete_objects = _complete_from("palpate.twin.objects", "OBJECTS")
complete_methods = _complete_from("palpate.settling.predict", "METHODS")
complete_demos = _complete_from("palpate.cli.demo", "NAMES")


def complete_rigs(incomplete: str) -> list[str]:
    """Return the rigs that have a name, and the rig files of the folder."""
    from palpate.rig import rig_names

    files = sorted(str(path) for path in Path().glob("*.toml"))
    return _filter_names([*rig_names(), *files], incomplete)


def complete_items(context: typer.Context, incomplete: str) -> list[str]:
    """Return the items of the store that the command line names, or of the usual one."""
    from palpate.errors import PalpateError
    from palpate.produce.store import Store

    try:
        with Store.open(context.params.get("store"), create=False) as store:
            known = [item.item_id for item in store.items()]
    except PalpateError:
        return []
    return _filter_names(known, incomplete)[:_MOST_ITEMS]


_FILE, _VARIABLE = Path("rig.toml"), "PALPATE_RIG"


def rig_of_environment() -> str | None:
    """Return the rig of this folder (`rig.toml`) or of the environment (`$PALPATE_RIG`)."""
    if _FILE.is_file():
        return str(_FILE)
    return os.environ.get(_VARIABLE) or None


def rig_or_port(rig: str | None, port: str | None) -> str | None:
    """Return the rig: `rig`, else without a port ./rig.toml or $PALPATE_RIG.

    Raises `InputError` if both are given.
    """
    if rig is not None and port is not None:
        raise InputError("--port: a rig states that itself; leave it out with --rig")
    return rig if rig is not None or port is not None else rig_of_environment()


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
        autocompletion=complete_rigs,
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
        autocompletion=complete_objects,
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
        autocompletion=complete_rigs,
    ),
]
PortOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="Serial port of a 2x2 board with 4700 ohm; a rig file describes others.",
        metavar="PORT",
    ),
]

#: Of calibrations. Give it the default None.
CalibrationOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="File to make or renew. By default the rig file's, or calibration.json.",
        metavar="FILE",
    ),
]


Method: TypeAlias = Literal["palpate", "paper"]

MethodOption: TypeAlias = Annotated[
    Method, typer.Option(help="paper: fixed steps to contact, an exponential, a line for force.")
]
StepOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--step-mm", help="Paper's method: closing step before contact. [default: 1]", metavar="MM"
    ),
]
EpsilonOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--epsilon",
        help="Paper's method: mean change of contact, %. [default: -10]",
        metavar="PERCENT",
    ),
]
ExtraOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--extra-mm", help="Paper's method: closing after contact. [default: 0]", metavar="MM"
    ),
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        "--cutoff",
        help="Paper's method: seconds to the prediction. [default: 2.5]",
        metavar="SECONDS",
    ),
]


#: Setting of the paper's method -> its option.
_PAPER = {
    "step_mm": "--step-mm",
    "epsilon_percent": "--epsilon",
    "extra_mm": "--extra-mm",
    "cutoff_s": "--cutoff",
}


def paper_settings(method: Method, **settings: float | None) -> Paper | None:
    """Return the settings that a user asks for, None for the default method.

    `settings`: of `palpate.grasp.paper.Paper`; None is its default.
    Raises `InputError` if one is out of its range, or given without the paper's method.
    """
    from palpate.grasp.paper import Paper

    given: dict[str, Any] = {n: value for n, value in settings.items() if value is not None}
    if method != "paper":
        if given:
            options = ", ".join(_PAPER[name] for name in given)
            raise InputError(f"{options}: only with --method paper")
        return None
    try:
        return Paper(**given)
    except ValueError as error:
        raise InputError(str(error)) from error
