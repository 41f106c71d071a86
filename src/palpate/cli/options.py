"""Command-line options that several verbs share."""

from __future__ import annotations

import importlib
import os
import re
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import typer

from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.grasp.paper import Paper


def opt(usage: str, text: str, **settings: Any) -> Any:
    """Return a command-line option with its name, value placeholder and help text.

    `usage`: name and placeholder as the help prints them, such as ``--out FILE``.
    `settings`: further arguments of `typer.Option`.
    """
    name, _, metavar = usage.partition(" ")
    return typer.Option(name, help=text, metavar=metavar or None, **settings)


def refuse_options(given: Mapping[str, object], *, why: str) -> None:
    """Raise `InputError` with the reason `why` if any of the options has a value.

    `given`: option name -> value.
    """
    for name, value in given.items():
        if value is not None:
            raise InputError(f"{name} {value}: {why}")


#: Entry points of the package that stores items: `open` of `palpate grasp --item`, `complete`.
ITEMS = "palpate.items"


def _complete_from(module: str, table: str) -> Callable[[str], list[str]]:
    """Return a completion function for the names in a table, which is loaded on demand."""

    def complete(incomplete: str) -> list[str]:
        return filter_names(getattr(importlib.import_module(module), table), incomplete)

    return complete


def filter_names(names: Iterable[str], incomplete: str) -> list[str]:
    """Return the names that begin with the incomplete one."""
    return [name for name in names if name.startswith(incomplete)]


complete_objects = _complete_from("palpate.twin.objects", "OBJECTS")
complete_methods = _complete_from("palpate.settling.predict", "METHODS")


def complete_rigs(incomplete: str) -> list[str]:
    """Return the names of built-in rigs and the rig files in the current folder."""
    from palpate.rig import rig_names

    files = sorted(str(path) for path in Path().glob("*.toml"))
    return filter_names([*rig_names(), *files], incomplete)


def complete_items(context: typer.Context, incomplete: str) -> list[str]:
    """Return the item names of the station's store; none if the station is not installed."""
    for point in entry_points(group=ITEMS, name="complete"):
        names: list[str] = point.load()(context, incomplete)
        return names
    return []


def parse_address(text: str, *, option: str) -> tuple[str, int]:
    """Parse the value HOST:PORT or PORT of an option; the default host is 127.0.0.1.

    Raises `InputError` if the text has neither form.

    >>> parse_address("[::1]:8765", option="--foxglove"), parse_address("0", option="--opcua")
    (('::1', 8765), ('127.0.0.1', 0))
    """
    host, _, port = text.rpartition(":")
    if not (port.isascii() and port.isdecimal()) or int(port) > 65535:
        raise InputError(f"{option} {text}: give HOST:PORT or PORT, a number up to 65535")
    return host.strip("[]") or "127.0.0.1", int(port)


_FILE, _VARIABLE = Path("rig.toml"), "PALPATE_RIG"


def find_default_rig() -> str | None:
    """Return `rig.toml` if the current folder has one, otherwise the value of `$PALPATE_RIG`."""
    if _FILE.is_file():
        return str(_FILE)
    return os.environ.get(_VARIABLE) or None


def resolve_rig(rig: str | None, port: str | None) -> str | None:
    """Return `rig`; if neither rig nor port is given, ./rig.toml or $PALPATE_RIG.

    Raises `InputError` if both rig and port are given.
    """
    if rig is not None and port is not None:
        raise InputError(
            "--port can't be combined with --rig, because the rig file sets the port; omit --port"
        )
    return rig if rig is not None or port is not None else find_default_rig()


def _choose_rig(rig: str) -> str:
    """Return the requested rig, the default rig of the folder or environment, or the twin."""
    from palpate.rig import DEFAULT_RIG

    return rig or find_default_rig() or DEFAULT_RIG


#: Requires the default "", which means ./rig.toml, then $PALPATE_RIG, then the simulated rig.
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

#: Requires the default False.
JsonOption: TypeAlias = Annotated[bool, opt("--json", "Print one JSON document.")]

#: Requires the default 20.
HorizonOption: TypeAlias = Annotated[
    float, opt("--horizon SECONDS", "Time of the settled value, from the start of the hold.")
]

# How recordings of a logger are read. Require the default None.
IntervalOption: TypeAlias = Annotated[
    float | None,
    opt("--interval SECONDS", "Time between the rows of a table without a clock."),
]
SheetOption: TypeAlias = Annotated[
    str | None,
    opt("--sheet NAME", "Sheet of a workbook. [default: the first with times and readings]"),
]
DecimalOption: TypeAlias = Annotated[
    Literal["point", "comma"] | None,
    opt("--decimal MARK", "Decimal mark: point or comma. [default: from the numbers]"),
]


#: Prefixes of a resistance, as printed on resistors and in part lists.
_OHM_PREFIXES = {"": 1.0, "r": 1.0, "k": 1e3, "m": 1e6}


def parse_ohm(text: str) -> float:
    """Return a resistance such as 4700, 4.7k, 4k7 or 1M, ohm.

    Raises `InputError` if it is none.

    >>> [parse_ohm(text) for text in ("4700", "10k", "4k7", "1 MΩ", "10 kOhm")]
    [4700.0, 10000.0, 4700.0, 1000000.0, 10000.0]
    """
    joined = text.strip().replace(" ", "").replace(",", ".")
    plain = re.sub(r"(?i)(ohms?|\u03a9|\u2126)$", "", joined)
    found = re.fullmatch(r"(?i)(-?\d*\.?\d+|\d+\.)([rkm]?)(\d*)", plain)
    if not found or (found[3] and ("." in found[1] or not found[2])):
        raise InputError(f"{text!r} is not a resistance; give ohms, such as 4700, 4.7k or 10k")
    number = f"{found[1]}.{found[3]}" if found[3] else found[1]
    return float(number) * _OHM_PREFIXES[found[2].lower()]


#: Requires the default None.
ReferenceOhmOption: TypeAlias = Annotated[
    float | None,
    opt(
        "--reference-ohm OHM",
        "The divider's fixed resistor, such as 4700 or 10k.",
        parser=parse_ohm,
    ),
]

#: Each requires the default None: how a table is read.
TimeColumnOption: TypeAlias = Annotated[
    str | None, opt("--time-column NAME", "Time column. [default: from common names]")
]
TimeUnitOption: TypeAlias = Annotated[
    Literal["s", "ms", "us", "unix"] | None,
    opt("--time-unit UNIT", "s, ms, us or unix. [default: from column name and values]"),
]
UnitOption: TypeAlias = Annotated[
    Literal["ohm", "percent", "counts", "volt"] | None,
    opt("--unit UNIT", "ohm, percent, counts or volt. [default: from column names]"),
]
SensorLegOption: TypeAlias = Annotated[
    Literal["upper", "lower"] | None,
    opt("--sensor-leg LEG", "Position of the sensor: upper (at the supply) or lower (at ground)."),
]

#: Requires the default False.
QuietOption: TypeAlias = Annotated[
    bool, opt("--quiet", "Hide the progress bar (always hidden without a terminal).")
]


def _check_force(target_force_n: float | None) -> float | None:
    """Return the force; raise `InputError` if it is outside the range of all grasps."""
    from palpate.grasp.planning import check_target_force

    check_target_force(target_force_n, name="--target-force-n")
    return target_force_n


#: Requires the default None.
TargetForceOption: TypeAlias = Annotated[
    float | None,
    opt(
        "--target-force-n NEWTONS",
        "Target grip force. [default: a gentle squeeze]",
        callback=_check_force,
    ),
]

#: Requires the default None.
StoreOption: TypeAlias = Annotated[
    str | None,
    opt(
        "--store FILE_OR_URL",
        "The item store: a file, or the URL of a PostgreSQL database. By default "
        "$PALPATE_STORE, then palpate-items.sqlite in this folder.",
        show_default=False,
    ),
]

#: Requires the default None.
PlotOption: TypeAlias = Annotated[
    Path | None, opt("--plot FILE", "Write a plot to a .png, .svg or .pdf file.")
]

RecordingArgument: TypeAlias = Annotated[
    Path, typer.Argument(help="An .mcap recording, complete or interrupted.")
]

#: Requires the default None.
ObjectOption: TypeAlias = Annotated[
    str | None,
    opt(
        "--object NAME",
        "Simulated rigs: the object between the fingers; by default chosen by the seed.",
        autocompletion=complete_objects,
    ),
]

#: Requires the default None.
DamageOption: TypeAlias = Annotated[
    Path | None,
    opt(
        "--damage FILE",
        "Limit the force with a damage model: a file from `palpate calibrate damage`.",
    ),
]

#: Requires the default 0.
SeedOption: TypeAlias = Annotated[
    int, opt("--seed", "Simulated rigs: seed of the random numbers.", min=0)
]

#: Requires the default None.
SimulatedRateOption: TypeAlias = Annotated[
    float | None,
    opt(
        "--rate-hz HZ",
        "Simulated rigs: frames per second, such as 15 of the paper's board. [default: 250]",
        min=1.0,
        max=1000.0,
    ),
]

# Options of verbs that read a sensor: a rig, or a board on a port. Require the default None.
SensorOption: TypeAlias = Annotated[
    str | None,
    opt("--rig NAME_OR_TOML", "Name of a rig, or a rig file.", autocompletion=complete_rigs),
]
PortOption: TypeAlias = Annotated[
    str | None,
    opt(
        "--port PORT", "Serial port of a 2x2 board with 4700 ohm; for other boards use a rig file."
    ),
]

#: For calibrations. Requires the default None.
CalibrationOption: TypeAlias = Annotated[
    Path | None,
    opt(
        "--out FILE",
        "File to create or update. By default the rig file's calibration, or calibration.json.",
    ),
]


Method: TypeAlias = Literal["palpate", "paper"]

MethodOption: TypeAlias = Annotated[
    Method,
    opt("--method", "paper: fixed steps to contact, an exponential fit, a linear force law."),
]
StepOption: TypeAlias = Annotated[
    float | None, opt("--step-mm MM", "Paper's method: closing step before contact. [default: 1]")
]
EpsilonOption: TypeAlias = Annotated[
    float | None,
    opt(
        "--epsilon PERCENT", "Paper's method: mean change that counts as contact, %. [default: -10]"
    ),
]
ExtraOption: TypeAlias = Annotated[
    float | None, opt("--extra-mm MM", "Paper's method: closing after contact. [default: 0]")
]
CutoffOption: TypeAlias = Annotated[
    float | None,
    opt(
        "--cutoff SECONDS",
        "Paper's method: time from the last movement to the prediction. [default: 2.5]",
    ),
]


#: Setting of the paper's method -> option.
_PAPER = {
    "method": "--method",
    "step_mm": "--step-mm",
    "epsilon_percent": "--epsilon",
    "extra_mm": "--extra-mm",
    "cutoff_s": "--cutoff",
}


def paper_settings(method: Method, **settings: float | None) -> Paper | None:
    """Return the settings of the paper's method; None for the default method.

    `settings`: fields of `palpate.grasp.paper.Paper`; None means the field's default.
    Raises `InputError` if a setting is out of range, or given without the paper's method.
    """
    from palpate.grasp.paper import read_settings

    return read_settings(method, settings, names=_PAPER)
