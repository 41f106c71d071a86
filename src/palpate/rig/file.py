"""Rig files: TOML that names an array, a gripper and the calibration that fits them."""

from __future__ import annotations

import importlib
import inspect
import tomllib
from pathlib import Path
from typing import Any

from palpate.clock import RealClock
from palpate.errors import InputError, PalpateError
from palpate.rig import Rig, open_rig
from palpate.sensor.calibration import Calibration

_EXAMPLE = 'e.g. open = "my_package.my_module:open_array"'


def open_file(path: Path, *, object_name: str | None, seed: int) -> Rig:
    """Open the rig that a file describes.

    Either ``use = "sim-rigid"``: another rig by name. Or a ``calibration`` file, and tables
    ``[array]`` and ``[gripper]`` each with ``open = "module:function"``; what else a table holds
    goes to that function by keyword. A gripper's function with a parameter ``array`` gets the open
    array too: fingers on the sensor's own board.

    Raises
    ------
    InputError
        If the file can't be read, or lacks or misnames something; one line that says what.
    """
    try:
        stated = tomllib.loads(path.read_text())
    except OSError as error:
        raise InputError(f"rig file {path}: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"rig file {path}: {error}") from error
    if "use" in stated:
        if stated.keys() != {"use"}:
            raise InputError(f"rig file {path}: `use` stands alone; leave the rest out")
        return open_rig(str(stated["use"]), object_name=object_name, seed=seed)
    wanted = {"calibration", "array", "gripper"}
    if stated.keys() != wanted:
        found = ", ".join(sorted(stated)) or "nothing"
        raise InputError(
            f"rig file {path}: needs `use`, or calibration, [array] and [gripper]; found {found}"
        )
    calibration = Calibration.load(path.parent / str(stated["calibration"]))
    array = _opened(path, "array", stated["array"])
    try:
        gripper = _opened(path, "gripper", stated["gripper"], array=array)
    except PalpateError:
        array.close()
        raise
    return Rig(
        name=path.name,
        array=array,
        gripper=gripper,
        clock=RealClock(),
        calibration=calibration,
    )


def _opened(path: Path, part: str, table: Any, **shared: Any) -> Any:
    """Call the opener that a table names; it gets what is shared if it has a parameter for it."""
    where = table.get("open") if isinstance(table, dict) else None
    if not isinstance(where, str) or ":" not in where:
        raise InputError(f"rig file {path}: [{part}] needs `open`, {_EXAMPLE}")
    module_name, _, function = where.partition(":")
    try:
        opener = getattr(importlib.import_module(module_name), function)
    except (ImportError, AttributeError) as error:
        raise InputError(f"rig file {path}: [{part}] open = {where!r}: {error}") from error
    try:
        asked = {name: value for name, value in shared.items() if _takes(opener, name)}
        return opener(**{key: value for key, value in table.items() if key != "open"}, **asked)
    except TypeError as error:
        raise InputError(f"rig file {path}: [{part}]: {error}") from error


def _takes(opener: Any, name: str) -> bool:
    try:
        return name in inspect.signature(opener).parameters
    except ValueError:  # built in, without a signature
        return False
