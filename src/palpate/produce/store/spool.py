"""Import of the spool, the file in which earlier versions let records wait for a store."""

from __future__ import annotations

import hashlib
import json
import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import TypeAlias

from palpate.errors import InputError
from palpate.estimate.measurement import Measurement
from palpate.files import atomic_path
from palpate.produce.records import Grasp, Item, Verdict
from palpate.produce.store.engine import sa
from palpate.settling.result import Status

_TIMES = ("first_seen", "taken_at", "given_at")
#: A record of a spool: text is that of a calibration.
SpoolRecord: TypeAlias = Item | Grasp | Verdict | str


def state_folder() -> Path:
    """Return palpate's folder in ``$XDG_STATE_HOME``, by default ``~/.local/state``."""
    return Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state") / "palpate"


def file_of(store: str, *, prefix: str, suffix: str) -> str:
    """Return a file name of a store's own, the same each time."""
    return f"{prefix}-{hashlib.sha256(store.encode()).hexdigest()[:12]}{suffix}"


def spool_path(store: str) -> Path:
    """Return where an earlier version let the records of a store wait."""
    folder = Path(os.environ.get("PALPATE_SPOOL") or state_folder())
    return folder / file_of(store, prefix="spool", suffix=".jsonl")


def import_spool(
    path: Path, *, connection: sa.Connection, write: Callable[[sa.Connection, SpoolRecord], object]
) -> str:
    """Write the records of a leftover spool to the store; return a line about it.

    Lines that are damaged, or that the store refuses, are copied to a file next to the spool before
    the rest is written. The caller renames the spool once the transaction is committed.
    """
    taken, refused = 0, b""
    for line in filter(None, path.read_bytes().split(b"\n")):
        try:
            with connection.begin_nested():
                write(connection, _read_line(line))
            taken += 1
        except (InputError, sa.exc.IntegrityError):
            refused += line + b"\n"
    note = f"{taken} records that waited for the store in {path} are now in it"
    if refused:
        aside = path.with_suffix(".refused")
        with suppress(FileNotFoundError):
            refused = aside.read_bytes() + refused
        with atomic_path(aside) as partial:
            partial.write_bytes(refused)
        note += f"; damaged or refused ones are in {aside}: enter them again with `palpate items`"
    return note


def _read_line(line: bytes) -> SpoolRecord:
    checksum, _, text = line.partition(b" ")
    try:
        if int(checksum, 16) != zlib.crc32(text):
            raise InputError("the line is cut")
        ((kind, values),) = json.loads(text).items()
        for name in _TIMES:
            if values.get(name) is not None:
                values[name] = datetime.fromisoformat(values[name])
        if kind == "calibration":
            return str(values["content"])
        if kind == "grasp":
            values["measurements"] = {
                name: Measurement(**{**measured, "status": Status(measured["status"])})
                for name, measured in values["measurements"].items()
            }
            if values["pixel_settled_percent"] is not None:
                values["pixel_settled_percent"] = tuple(map(tuple, values["pixel_settled_percent"]))
        kinds: dict[str, type[Item | Grasp | Verdict]] = {
            "item": Item,
            "grasp": Grasp,
            "verdict": Verdict,
        }
        return kinds[kind](**values)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise InputError(f"not a record of the store ({error})") from error
