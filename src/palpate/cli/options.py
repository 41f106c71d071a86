"""Options that several verbs share, each with one wording."""

from __future__ import annotations

import importlib
import os
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.grasp.paper import Paper


def opt(usage: str, text: str, **settings: Any) -> Any:
    """Return a command-line option with its name, value placeholder and help text.

    `usage`: as the help prints it, such as ``--out FILE``.
    `settings`: further ones of `typer.Option`.
    """
    name, _, metavar = usage.partition(" ")
    return typer.Option(name, help=text, metavar=metavar or None, **settings)


def refuse_options(given: Mapping[str, object], *, why: str) -> None:
    """Raise `InputError` if one of these options, by name, has a value."""
    for name, value in given.items():
        if value is not None:
            raise InputError(f"{name} {value}: {why}")


#: Items offered at most: a shell lists them all at once.
_MOST_ITEMS = 200


def _complete_from(module: str, table: str) -> Callable[[str], list[str]]:
    """Return the completion of the names in a table, loaded on demand."""

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
    """Return the items of the store on the command line, or of the default one."""
    from palpate.errors import PalpateError
    from palpate.produce.store import Store

    try:
        with Store.open(context.params.get("store"), create=False) as store:
            known = [item.item_id for item in store.items()]
    except PalpateError:
        return []
    return _filter_names(known, incomplete)[:_MOST_ITEMS]


def host_and_port(text: str, *, option: str) -> tuple[str, int]:
    """Return host and port of an option; a port alone is one of this machine.

    Raises `InputError` if the text is neither.

    >>> host_and_port("[::1]:8765", option="--foxglove"), host_and_port("0", option="--opcua")
    (('::1', 8765), ('127.0.0.1', 0))
    """
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdecimal()) or int(port) > 65535:
        raise InputError(f"{option} {text}: give HOST:PORT or PORT, such as 127.0.0.1:4840")
    return host.strip("[]") or "127.0.0.1", int(port)


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
        raise InputError("--port: the rig states its port; leave it out with --rig")
    return rig if rig is not None or port is not None else rig_of_environment()


def _choose_rig(rig: str) -> str:
    """Return the requested rig, the folder's, or the twin, whose output is labelled."""
    from palpate.rig import DEFAULT_RIG

    return rig or rig_of_environment() or DEFAULT_RIG


#: Give it the default "": ./rig.toml, then $PALPATE_RIG, then the simulated rig.
RigOption: TypeAlias = Annotated[
    str,
    opt(
        "--rig NAME_OR_TOML",
        "A rig file, or a built-in rig. By default ./rig.toml, then $PALPATE_RIG, then "
        "sim-rigid (simulated).",
        autocompletion=complete_rigs,
        callback=_choose_rig,
        show_default=False,
    ),
]

#: Give it the default False.
JsonOption: TypeAlias = Annotated[bool, opt("--json", "Print one JSON document.")]

#: Give it the default 20.
HorizonOption: TypeAlias = Annotated[float, opt("--horizon SECONDS", "Time of the settled value.")]

#: Give it the default False.
QuietOption: TypeAlias = Annotated[
    bool, opt("--quiet", "No progress bar (nor is there one without a terminal).")
]


def _check_force(target_force_n: float | None) -> float | None:
    """Refuse a force that no grasp may reach."""
    from palpate.grasp.planning import check_target_force

    check_target_force(target_force_n, name="--target-force-n")
    return target_force_n


#: Give it the default None.
TargetForceOption: TypeAlias = Annotated[
    float | None,
    opt(
        "--target-force-n NEWTONS",
        "Grip force to reach; a gentle squeeze by default.",
        callback=_check_force,
    ),
]

#: Give it the default None.
StoreOption: TypeAlias = Annotated[
    str | None,
    opt(
        "--store FILE_OR_URL",
        "The store of items: a file, or the URL of a PostgreSQL database. By default "
        "$PALPATE_STORE, then palpate-items.sqlite in this folder.",
        show_default=False,
    ),
]

#: Give them the default None.
BatchOption: TypeAlias = Annotated[str | None, opt("--batch NAME", "Items of this batch.")]
DayOption: TypeAlias = Annotated[
    str | None, opt("--day DATE", "Items grasped on this day, here: 2026-05-01.")
]

#: One item of the store.
ItemArgument: TypeAlias = Annotated[
    str,
    typer.Argument(
        help="An item that was grasped before.", metavar="ITEM", autocompletion=complete_items
    ),
]

#: Give it the default None.
PlotOption: TypeAlias = Annotated[
    Path | None, opt("--plot FILE", "Draw it: a file that ends in .png, .svg or .pdf.")
]

#: Of a recording.
RecordingArgument: TypeAlias = Annotated[
    Path, typer.Argument(help="An .mcap recording, finished or not.")
]

#: Give it the default None.
ObjectOption: TypeAlias = Annotated[
    str | None,
    opt(
        "--object NAME",
        "Simulated rigs: the object between the fingers; by default drawn by the seed.",
        autocompletion=complete_objects,
    ),
]

#: Give it the default None.
DamageOption: TypeAlias = Annotated[
    Path | None,
    opt(
        "--damage FILE",
        "Stay below the force that such produce withstands: a file of `palpate calibrate damage`.",
    ),
]

#: Give it the default 0.
SeedOption: TypeAlias = Annotated[
    int, opt("--seed", "Simulated rigs: seed of all that is random.", min=0)
]

# Of every verb that reads a sensor: a rig, or a board on a port. Give them the default None.
SensorOption: TypeAlias = Annotated[
    str | None,
    opt("--rig NAME_OR_TOML", "Name of a rig, or a rig file.", autocompletion=complete_rigs),
]
PortOption: TypeAlias = Annotated[
    str | None,
    opt("--port PORT", "Serial port of a 2x2 board with 4700 ohm; a rig file describes others."),
]

#: Of calibrations. Give it the default None.
CalibrationOption: TypeAlias = Annotated[
    Path | None,
    opt("--out FILE", "File to make or renew. By default the rig file's, or calibration.json."),
]


Method: TypeAlias = Literal["palpate", "paper"]

MethodOption: TypeAlias = Annotated[
    Method, opt("--method", "paper: fixed steps to contact, an exponential, a line for force.")
]
StepOption: TypeAlias = Annotated[
    float | None, opt("--step-mm MM", "Paper's method: closing step before contact. [default: 1]")
]
EpsilonOption: TypeAlias = Annotated[
    float | None,
    opt("--epsilon PERCENT", "Paper's method: mean change of contact, %. [default: -10]"),
]
ExtraOption: TypeAlias = Annotated[
    float | None, opt("--extra-mm MM", "Paper's method: closing after contact. [default: 0]")
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    opt("--cutoff SECONDS", "Paper's method: seconds to the prediction. [default: 2.5]"),
]


#: Setting of the paper's method -> its option.
_PAPER = {
    "step_mm": "--step-mm",
    "epsilon_percent": "--epsilon",
    "extra_mm": "--extra-mm",
    "cutoff_s": "--cutoff",
}


def paper_settings(method: Method, **settings: float | None) -> Paper | None:
    """Return the settings of the paper's method; None for the default method.

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
