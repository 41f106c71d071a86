"""Rig files: TOML descriptions of an array, a gripper and their calibration."""

from __future__ import annotations

import importlib
import inspect
import math
import os
import sys
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from palpate.calibration import Calibration
from palpate.clock import RealClock
from palpate.errors import CalibrationError, DeviceError, InputError, PalpateError
from palpate.gripper.interface import Gripper
from palpate.gripper.no_gripper import NoGripper
from palpate.gripper.plain import PlainGripper
from palpate.rig import Rig, open_rig
from palpate.sensor.array import PressureArray
from palpate.sensor.frame_port import PortArray

#: Required parts of a rig file, and their names in messages; others are optional.
_REQUIRED_PARTS = {"array": "table [array]", "calibration": '`calibration = "FILE"`'}
_OPTIONAL_PARTS = ("gripper", "load_cells")
_INIT_HINT = (
    "`palpate init FILE --gripper KIND` writes a complete file; --rig sim-rigid is simulated"
)
_EXAMPLE = 'e.g. open = "my_package.my_module:open_array"'
_TYPE_NAMES: Mapping[Any, str] = {
    str: "text in quotes",
    int: "a whole number",
    float: "a finite number",
    bool: "true or false",
}
#: What palpate needs of the object that an opener returns.
_DEVICE_NAMES: Mapping[str, tuple[str, ...]] = {
    "array": ("layout", "close"),
    "gripper": ("close",),
}
#: Supported numbers of load cells.
_CELL_COUNTS = (1, 2)


@dataclass(frozen=True, slots=True, kw_only=True)
class RigFile:
    """The checked contents of the rig file of a real rig."""

    #: The rig file.
    path: Path
    #: Calibration file, which may not exist yet.
    calibration: Path
    #: Tables of the array and the gripper, as in the file; None without a gripper.
    array: Any
    gripper: Any
    #: Scale of each load cell in use, cell 0 first; None without load cells.
    newtons_per_count: tuple[float, ...] | None


def open_file(
    path: Path, *, object_name: str | None, seed: int, gripper: Gripper | None = None
) -> Rig:
    """Open the rig described by a file.

    `gripper`: used instead of that of the file, which may have none.

    The file has one of two forms. With ``use = "sim-rigid"`` it names another rig; an optional
    ``calibration`` file replaces that rig's own. Otherwise the file has a ``calibration`` file and
    tables ``[array]`` and ``[gripper]``, each with ``open = "module:function"``. The function
    receives the other keys of its table as keyword arguments. If a gripper's function has a
    parameter ``array``, it also receives the open array (for fingers on the sensor's own board). A
    table ``[load_cells]`` with ``newtons_per_count = [...]`` is used for calibration.

    Raises `InputError` with one line if the file can't be read, or a key is missing or unknown;
    `CalibrationError` if the calibration can't be read, or belongs to another layout, divider or
    wiring; `DeviceError` if equipment is missing.
    """
    stated = read_rig_table(path)
    if "use" in stated:
        if gripper is not None:
            raise InputError(f"rig file {path}: `use` has a gripper of its own; omit gripper=...")
        if not stated.keys() <= {"use", "calibration"}:
            raise InputError(
                f"rig file {path}: only `calibration` is allowed together with `use`; remove the "
                "other keys"
            )
        calibrated = find_calibration_file(path)
        rig = open_rig(resolve_used_rig(path, stated), object_name=object_name, seed=seed)
        if calibrated is None:
            return rig
        return replace_calibration(rig, calibrated)
    rig_file = read_rig_file(path)
    calibration = Calibration.load(rig_file.calibration)
    if gripper is None and rig_file.gripper is None:
        gripper = NoGripper()
    if gripper is None:
        array, gripper = open_devices(rig_file)
    else:
        array = open_device(path, "array", rig_file.array)
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


def replace_calibration(rig: Rig, file: Path) -> Rig:
    """Return a rig with its calibration replaced by that of a file.

    Raises `CalibrationError` and closes the rig if the file can't be read or belongs to another
    sensor.
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
    """Check that a calibration belongs to a sensor.

    Raises `CalibrationError` if the layout, divider or wiring differs.
    """
    if difference := calibration.layout.describe_difference(array.layout):
        raise CalibrationError(
            f"calibration {file}: it belongs to another sensor ({difference}); fix [array] in "
            f"{rig_file}, or calibrate again"
        )


def resolve_used_rig(path: Path, stated: Mapping[str, Any]) -> str:
    """Return the name of the rig in `use`.

    Raises `InputError` if `use` names a rig file with another `use`, because such files could form
    a cycle.
    """
    used = stated["use"]
    if not isinstance(used, str) or not used or "\0" in used:
        raise InputError(
            f'rig file {path}: use = {used!r:.40} is not a rig; e.g. use = "sim-rigid"'
        )
    if used.endswith(".toml") and Path(used).is_file() and "use" in read_rig_table(Path(used)):
        raise InputError(
            f"rig file {path}: `use` names {used}, which also has a `use`; name a rig instead"
        )
    return used


def read_rig_file(path: Path) -> RigFile:
    """Read the file of a real rig without opening devices.

    Raises `InputError` with one line if the file can't be read, or a key is missing or unknown.
    """
    stated = read_rig_table(path)
    for name, what in _REQUIRED_PARTS.items():
        if name not in stated:
            found = ", ".join(sorted(stated)) or "nothing"
            raise InputError(f"rig file {path}: no {what}; found {found}. {_INIT_HINT}")
    known = (*_REQUIRED_PARTS, *_OPTIONAL_PARTS)
    if unknown := stated.keys() - set(known):
        raise InputError(
            f"rig file {path}: unknown key {', '.join(sorted(unknown))}; available: use, "
            f"{', '.join(known)}"
        )
    return RigFile(
        path=path,
        calibration=_calibration_path(path, stated),
        array=stated["array"],
        gripper=stated.get("gripper"),
        newtons_per_count=_parse_newtons_per_count(path, stated),
    )


def read_load_cells(path: Path) -> tuple[float, ...] | None:
    """Return the newtons per count of a rig file's load cells, or None.

    Raises `InputError` if the file can't be read, or its table ``[load_cells]`` is invalid.
    """
    return _parse_newtons_per_count(path, read_rig_table(path))


def _parse_newtons_per_count(path: Path, stated: Mapping[str, Any]) -> tuple[float, ...] | None:
    if "load_cells" not in stated:
        return None
    table = stated["load_cells"]
    if not isinstance(table, dict) or table.keys() != {"newtons_per_count"}:
        found = ", ".join(sorted(table)) if isinstance(table, dict) else repr(table)
        raise InputError(
            f"rig file {path}: [load_cells] must contain newtons_per_count = [...] only; "
            f"found {found or 'nothing'}"
        )
    scales = table["newtons_per_count"]
    if not isinstance(scales, list) or len(scales) not in _CELL_COUNTS:
        raise InputError(
            f"rig file {path}: newtons_per_count must be a list with one number for each load cell "
            f"in use, 1 or 2; found {scales!r}"
        )
    for scale in scales:
        if type(scale) not in (int, float) or not math.isfinite(scale) or scale == 0:
            raise InputError(
                f"rig file {path}: newtons_per_count: {scale!r} is not a nonzero number; "
                "`palpate calibrate cell` measures it"
            )
    return tuple(float(scale) for scale in scales)


def open_devices(rig_file: RigFile) -> tuple[PressureArray, Gripper]:
    """Open the array and the gripper; close the array if the gripper fails to open.

    Raises `InputError` if an opener doesn't exist or rejects its options; `DeviceError` if
    equipment is missing.
    """
    array = open_device(rig_file.path, "array", rig_file.array)
    try:
        gripper = open_device(rig_file.path, "gripper", rig_file.gripper, array=array)
    except PalpateError as error:
        array.close()
        if isinstance(error, DeviceError) and _have_one_port(rig_file.array, rig_file.gripper):
            raise InputError(
                f"rig file {rig_file.path}: [gripper] port = {rig_file.gripper['port']!r} is also "
                "that of [array]; `palpate ports` lists the available ports"
            ) from error
        raise
    return array, gripper


def _have_one_port(array: object, gripper: object) -> bool:
    """Return whether two tables name the same port, perhaps through a link."""
    ports = [table.get("port") for table in (array, gripper) if isinstance(table, dict)]
    stated = [os.path.realpath(port) for port in ports if isinstance(port, str)]
    return len(stated) == 2 and stated[0] == stated[1]


def read_rig_table(path: Path) -> dict[str, Any]:
    """Return the unchecked contents of a rig file.

    Raises `InputError` if the file can't be read.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as error:
        raise InputError(f"rig file {path}: no such file; `palpate init` creates one") from error
    except OSError as error:
        raise InputError(f"rig file {path}: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise InputError(f"rig file {path}: not TOML: {error}") from error


def find_ports(name: str | None, *, array: PressureArray) -> list[str]:
    """Return the serial ports of a sensor and of the rig file that describes it.

    `name`: name of a rig, or path of a rig file.
    Raises `InputError` as `read_rig_table` does.
    """
    ports = [array.name] if isinstance(array, PortArray) else []
    if name is not None and name.endswith(".toml"):
        tables = read_rig_table(Path(name)).values()
        stated = (table.get("port") for table in tables if isinstance(table, dict))
        ports += [port for port in stated if isinstance(port, str)]
    return list(dict.fromkeys(ports))


def find_calibration_file(path: Path) -> Path | None:
    """Return the path of a rig file's calibration, existing or not; None if not stated.

    Raises `InputError` as `read_rig_table` does.
    """
    stated = read_rig_table(path)
    return _calibration_path(path, stated) if "calibration" in stated else None


def _calibration_path(path: Path, stated: Mapping[str, Any]) -> Path:
    """Return the path of the stated calibration, which may not exist yet."""
    name = stated["calibration"]
    if not isinstance(name, str) or not name or "\0" in name:
        raise InputError(f"rig file {path}: calibration = {name!r:.40} is not a file name")
    return path.parent / name


def open_device(path: Path, part: str, table: Any, **shared: Any) -> Any:
    """Call the opener of a table with its options and any matching `shared` objects.

    The opener's module is installed, or beside the rig file.
    Raises `InputError` if the table is missing (None), or its opener doesn't exist or rejects the
    options.
    """
    if table is None:
        found = ", ".join(sorted(read_rig_table(path))) or "nothing"
        raise InputError(f"rig file {path}: no table [{part}]; found {found}. {_INIT_HINT}")
    where = table.get("open") if isinstance(table, dict) else None
    # Last, so that a file there hides no installed module. It stays for the module's own imports.
    folder = str(path.resolve().parent)
    if folder not in sys.path:
        sys.path.append(folder)
    opener = _import_opener(where, place=f"rig file {path}: [{part}]")
    stated = {key: value for key, value in table.items() if key != "open"}
    if fault := find_option_fault(stated, opener):
        raise InputError(f"rig file {path}: [{part}] {fault}")
    try:
        accepted = list(inspect.signature(opener).parameters)
    except ValueError:  # a built-in without a signature
        accepted = []
    passed = {name: value for name, value in shared.items() if name in accepted}
    try:
        device = opener(**stated, **passed)
    except InputError as error:
        raise InputError(f"rig file {path}: [{part}] {error}") from error
    except (PalpateError, OSError):
        raise
    except (Exception, SystemExit) as error:
        why = f"{error}" if isinstance(error, TypeError | ValueError) else repr(error)
        raise InputError(f"rig file {path}: [{part}]: {_one_line(why)}") from error
    if part == "gripper" and not hasattr(device, "limits"):
        try:
            return PlainGripper(device)
        except InputError as error:
            raise InputError(f"rig file {path}: [{part}] open = {where!r}: {error}") from error
    absent = [name for name in _DEVICE_NAMES[part] if not hasattr(device, name)]
    if absent:
        raise InputError(
            f"rig file {path}: [{part}] open = {where!r} returns {device!r:.40}, which is not "
            f"{'an array' if part == 'array' else 'a gripper'}: it has no {' or '.join(absent)}"
        )
    return device


def _import_opener(where: object, *, place: str) -> Callable[..., Any]:
    """Return the function named "module:function".

    Raises `InputError` if the name has another form, or its function can't be imported.
    """
    if not isinstance(where, str) or ":" not in where:
        raise InputError(f"{place} needs `open`, {_EXAMPLE}")
    module_name, _, function = where.partition(":")
    if not all(part.isidentifier() for part in [*module_name.split("."), function]):
        raise InputError(f"{place} open = {where!r:.80} is not a module and a function, {_EXAMPLE}")
    try:
        opener = getattr(importlib.import_module(module_name), function)
    except ModuleNotFoundError as error:
        found = f"no module {error.name}"
        if error.name == module_name.partition(".")[0]:
            found += f"; put {error.name}.py beside the rig file, or install its package"
        raise InputError(f"{place} open = {where!r:.80}: {found}") from error
    except (Exception, SystemExit) as error:  # the module runs code of its own
        raise InputError(f"{place} open = {where!r:.80}: {_one_line(str(error))}") from error
    if not callable(opener):
        raise InputError(
            f"{place} open = {where!r:.80} is {opener!r:.40}, not a function, {_EXAMPLE}"
        )
    return cast(Callable[..., Any], opener)


def _one_line(text: str) -> str:
    return " ".join(text.split())


def find_option_fault(options: Mapping[str, Any], opener: Callable[..., Any]) -> str | None:
    """Return a description of the first invalid option of an opener, or None.

    `options`: keyword arguments by name.
    `opener`: function to call. Parameters without a plain type are not checked.

    >>> def open_board(*, port: str, rate_hz: float = 250.0): ...
    >>> find_option_fault({"port": 3}, open_board)
    'port = 3: it must be text in quotes'
    >>> find_option_fault({"prot": "/dev/ttyACM0"}, open_board)
    "unknown option 'prot'; available: port, rate_hz"
    """
    try:
        parameters = inspect.signature(opener).parameters
        hints = get_type_hints(opener)
    except (NameError, TypeError, ValueError):  # a built-in, or unresolvable type hints
        return None
    by_name = (inspect.Parameter.KEYWORD_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    named = [p.name for p in parameters.values() if p.kind in by_name]
    accepts_any = any(p.kind is p.VAR_KEYWORD for p in parameters.values())
    for name, value in options.items():
        if name not in named and not accepts_any:
            return f"unknown option {name!r}; available: {', '.join(named)}"
        if not _is_of_type(value, hints.get(name)):
            return f"{name} = {value!r}: it must be {describe_type(hints[name])}"
    return None


def _is_of_type(value: object, wanted: Any) -> bool:
    if wanted is float:
        return type(value) is int or (isinstance(value, float) and math.isfinite(value))
    if wanted in (str, int, bool):
        return type(value) is wanted
    if get_origin(wanted) is Literal:
        return value in get_args(wanted)
    if get_origin(wanted) in (Union, UnionType):
        return any(_is_of_type(value, one) for one in get_args(wanted) if one is not NoneType)
    return True


def describe_type(wanted: Any) -> str:
    """Return a description of the values that a type hint accepts."""
    if get_origin(wanted) is Literal:
        return f"one of {', '.join(map(repr, get_args(wanted)))}"
    if get_origin(wanted) in (Union, UnionType):
        return " or ".join(describe_type(one) for one in get_args(wanted) if one is not NoneType)
    return _TYPE_NAMES[wanted]
