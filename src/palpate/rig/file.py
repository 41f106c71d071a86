"""Rig files: TOML that names an array, a gripper and the calibration that fits them."""

from __future__ import annotations

import importlib
import inspect
import math
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from palpate.clock import RealClock
from palpate.errors import CalibrationError, InputError, PalpateError
from palpate.gripper.interface import Gripper
from palpate.rig import Rig, open_rig
from palpate.sensor.array import PressureArray
from palpate.sensor.calibration import Calibration

#: What every rig file has, and how a message calls it.
_PARTS = {
    "array": "table [array]",
    "gripper": "table [gripper]",
    "calibration": '`calibration = "FILE"`',
}
_MAKE = "`palpate init` writes a whole one (--gripper for the hand); --rig sim-rigid is simulated"
_EXAMPLE = 'e.g. open = "my_package.my_module:open_array"'
_WORDS: Mapping[Any, str] = {
    str: "text in quotes",
    int: "a whole number",
    float: "a finite number",
    bool: "true or false",
}
#: How many load cells a board reads.
_CELLS = (1, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFile:
    """A real rig as described by a rig file, checked."""

    #: The file.
    path: Path
    #: Made with this sensor on this gripper, or to be made.
    calibration: Path
    #: Their tables, as they stand in the file.
    array: Any
    gripper: Any
    #: Of each load cell in use, cell 0 first; None where the rig has none.
    newtons_per_count: tuple[float, ...] | None


def open_file(path: Path, *, object_name: str | None, seed: int) -> Rig:
    """Open the rig that a file describes.

    Either ``use = "sim-rigid"``: another rig by name, with the ``calibration`` file in place of its
    own where one is stated. Or a ``calibration`` file, and tables ``[array]`` and ``[gripper]``
    each with ``open = "module:function"``; what else a table holds goes to that function by
    keyword. A gripper's function with a parameter ``array`` gets the open array too: fingers on the
    sensor's own board. A table ``[load_cells]`` with ``newtons_per_count = [...]`` is for
    calibrating.

    Raises `InputError` if the file can't be read, or lacks or misnames something; one line that
    names it; `CalibrationError` if the calibration can't be read, or was made with another layout,
    divider or wiring; `DeviceError` if equipment isn't there.
    """
    stated = read_stated(path)
    if "use" in stated:
        if not stated.keys() <= {"use", "calibration"}:
            raise InputError(
                f"rig file {path}: next to `use` only `calibration` may stand; leave the rest out"
            )
        rig = open_rig(name_used_rig(path, stated), object_name=object_name, seed=seed)
        if "calibration" not in stated:
            return rig
        return with_calibration(rig, path.parent / str(stated["calibration"]))
    rig_file = read_rig_file(path)
    calibration = Calibration.load(rig_file.calibration)
    array, gripper = open_devices(rig_file)
    try:
        check_layout(calibration, array, file=rig_file.calibration, rig_file=path)
    except CalibrationError:
        gripper.close()
        array.close()
        raise
    return Rig(
        name=path.name,
        array=array,
        gripper=gripper,
        clock=RealClock(),
        calibration=calibration,
    )


def with_calibration(rig: Rig, file: Path) -> Rig:
    """Return a rig with the calibration of a file in place of its own.

    Raises `CalibrationError` if the file can't be read or is of another sensor; the rig is closed.
    """
    try:
        calibration = Calibration.load(file)
        check_layout(calibration, rig.array, file=file, rig_file=rig.name)
    except CalibrationError:
        rig.close()
        raise
    return replace(rig, calibration=calibration)


def check_layout(
    calibration: Calibration, array: PressureArray, *, file: Path, rig_file: Path | str
) -> None:
    """Refuse a calibration of another sensor.

    Raises `CalibrationError` if it was made with another layout, divider or wiring.
    """
    if difference := calibration.layout.describe_difference(array.layout):
        raise CalibrationError(
            f"calibration {file}: it is of another sensor ({difference}); fix [array] in "
            f"{rig_file}, or calibrate again"
        )


def name_used_rig(path: Path, stated: Mapping[str, Any]) -> str:
    """Return the rig that `use` names.

    Raises `InputError` if it names another rig file that only passes on: such files could name each
    other.
    """
    used = str(stated["use"])
    if used.endswith(".toml") and Path(used).is_file() and "use" in read_stated(Path(used)):
        raise InputError(f"rig file {path}: `use` names {used}, which has a `use` too; name a rig")
    return used


def read_rig_file(path: Path) -> RigFile:
    """Read the file of a real rig; nothing is opened.

    Raises `InputError` if the file can't be read, or lacks or misnames something; one line that
    names it.
    """
    stated = read_stated(path)
    for name, what in _PARTS.items():
        if name not in stated:
            found = ", ".join(sorted(stated)) or "nothing"
            raise InputError(f"rig file {path}: no {what}; found {found}. {_MAKE}")
    if unknown := stated.keys() - _PARTS.keys() - {"load_cells"}:
        raise InputError(
            f"rig file {path}: it knows no {', '.join(sorted(unknown))}; there are use, "
            f"{', '.join(_PARTS)}, load_cells"
        )
    if "\0" in str(stated["calibration"]):
        raise InputError(f"rig file {path}: calibration is no name of a file")
    return RigFile(
        path=path,
        calibration=path.parent / str(stated["calibration"]),
        array=stated["array"],
        gripper=stated["gripper"],
        newtons_per_count=_newtons_per_count(path, stated),
    )


def read_load_cells(path: Path) -> tuple[float, ...] | None:
    """Return the newtons per count stated for a rig file's load cells, or None.

    Raises `InputError` if the file can't be read, or its table ``[load_cells]`` is at fault.
    """
    return _newtons_per_count(path, read_stated(path))


def _newtons_per_count(path: Path, stated: Mapping[str, Any]) -> tuple[float, ...] | None:
    if "load_cells" not in stated:
        return None
    table = stated["load_cells"]
    if not isinstance(table, dict) or table.keys() != {"newtons_per_count"}:
        found = ", ".join(sorted(table)) if isinstance(table, dict) else repr(table)
        raise InputError(
            f"rig file {path}: [load_cells] holds newtons_per_count = [...] and nothing else; "
            f"found {found or 'nothing'}"
        )
    scales = table["newtons_per_count"]
    if not isinstance(scales, list) or len(scales) not in _CELLS:
        raise InputError(
            f"rig file {path}: newtons_per_count is a list of one number for each load cell in "
            f"use, 1 or 2; found {scales!r}"
        )
    for scale in scales:
        if type(scale) not in (int, float) or not math.isfinite(scale) or scale == 0:
            raise InputError(
                f"rig file {path}: newtons_per_count: {scale!r} is no number of newtons per "
                "count; `palpate calibrate cell` measures it"
            )
    return tuple(float(scale) for scale in scales)


def open_devices(rig_file: RigFile) -> tuple[PressureArray, Gripper]:
    """Open array and gripper; where the gripper does not open, the array is closed again.

    Raises `InputError` if an opener is misnamed or refuses what its table holds; `DeviceError` if
    equipment isn't there.
    """
    array = open_stated(rig_file.path, "array", rig_file.array)
    try:
        gripper = open_stated(rig_file.path, "gripper", rig_file.gripper, array=array)
    except PalpateError:
        array.close()
        raise
    return array, gripper


def read_stated(path: Path) -> dict[str, Any]:
    """Return what a rig file states, unchecked.

    Raises `InputError` if it can't be read.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as error:
        raise InputError(f"rig file {path}: no such file; `palpate init` makes one") from error
    except OSError as error:
        raise InputError(f"rig file {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"rig file {path}: not TOML: {error}") from error


def find_calibration_file(path: Path) -> Path | None:
    """Return the path of a rig file's calibration, made or not; None without one.

    Raises `InputError` as `read_stated` does.
    """
    stated = read_stated(path)
    return path.parent / str(stated["calibration"]) if "calibration" in stated else None


def open_stated(path: Path, part: str, table: Any, **shared: Any) -> Any:
    """Call the opener that a table names, with the shared objects that it takes.

    Raises `InputError` if there is no such table (None), or its opener is misnamed or refuses what
    it holds.
    """
    if table is None:
        found = ", ".join(sorted(read_stated(path))) or "nothing"
        raise InputError(f"rig file {path}: no table [{part}]; found {found}. {_MAKE}")
    where = table.get("open") if isinstance(table, dict) else None
    if not isinstance(where, str) or ":" not in where:
        raise InputError(f"rig file {path}: [{part}] needs `open`, {_EXAMPLE}")
    module_name, _, function = where.partition(":")
    try:
        opener = getattr(importlib.import_module(module_name), function)
    except (ImportError, AttributeError) as error:
        raise InputError(f"rig file {path}: [{part}] open = {where!r}: {error}") from error
    stated = {key: value for key, value in table.items() if key != "open"}
    if fault := fault_in(stated, opener):
        raise InputError(f"rig file {path}: [{part}] {fault}")
    try:
        takes = list(inspect.signature(opener).parameters)
    except ValueError:  # built in, without a signature
        takes = []
    asked = {name: value for name, value in shared.items() if name in takes}
    try:
        return opener(**stated, **asked)
    except (TypeError, ValueError) as error:
        raise InputError(f"rig file {path}: [{part}]: {error}") from error


def fault_in(options: Mapping[str, Any], opener: Callable[..., Any]) -> str | None:
    """Return what an opener could not take of some options, in words; None if nothing.

    `options`: what is stated, by name.
    `opener`: what is to get them by keyword. Parameters without a plain type are not checked.

    >>> def open_board(*, port: str, rate_hz: float = 250.0): ...
    >>> fault_in({"port": 3}, open_board)
    'port = 3: it must be text in quotes'
    >>> fault_in({"prot": "/dev/ttyACM0"}, open_board)
    "it knows no 'prot'; there are port, rate_hz"
    """
    try:
        parameters = inspect.signature(opener).parameters
        hints = get_type_hints(opener)
    except (NameError, TypeError, ValueError):  # built in, or with types that do not exist
        return None
    by_name = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    named = [p.name for p in parameters.values() if p.kind in by_name]
    takes_all = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    for name, value in options.items():
        if name not in named and not takes_all:
            return f"it knows no {name!r}; there are {', '.join(named)}"
        if not _fits(value, hints.get(name)):
            return f"{name} = {value!r}: it must be {in_words(hints[name])}"
    return None


def _fits(value: object, wanted: Any) -> bool:
    if wanted is float:
        return type(value) is int or (isinstance(value, float) and math.isfinite(value))
    if wanted in (str, int, bool):
        return type(value) is wanted
    if get_origin(wanted) is Literal:
        return value in get_args(wanted)
    if get_origin(wanted) in (Union, UnionType):
        return any(_fits(value, one) for one in get_args(wanted) if one is not NoneType)
    return True


def in_words(wanted: Any) -> str:
    """Return what a value must be to fit a type hint, in words."""
    if get_origin(wanted) is Literal:
        return f"one of {', '.join(map(repr, get_args(wanted)))}"
    if get_origin(wanted) in (Union, UnionType):
        return " or ".join(in_words(one) for one in get_args(wanted) if one is not NoneType)
    return _WORDS[wanted]
