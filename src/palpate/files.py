"""Atomic writing of files, checks of output paths, and conversion of JSON to dataclasses."""

from __future__ import annotations

import json
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from palpate.errors import InputError

#: Characters that begin a formula in a spreadsheet, or hide its beginning.
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
#: Limit for numbers in files; no quantity is larger.
_LARGEST = 1e300

T = TypeVar("T")


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path next to `path`; move it into place if the block succeeds.

    `path`: the finished file; its folder must exist.
    Yields the path of an empty file in the same folder with the same extension.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with atomic_path(folder / "note.txt") as partial:
    ...     _ = partial.write_text("whole")
    >>> [p.name for p in folder.iterdir()], (folder / "note.txt").read_text()
    (['note.txt'], 'whole')
    """
    # Replace the target of a symbolic link, not the link.
    final = Path(path).resolve()
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{final.stem}-", suffix="".join(final.suffixes), dir=final.parent
        )
    except OSError as error:
        # The message must name the requested file, not the temporary file.
        raise OSError(error.errno, error.strerror, str(path)) from error
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
        # Windows syncs only files that are open for writing.
        with partial.open("r+b") as written:
            os.fsync(written.fileno())
        partial.chmod(_file_mode(final))
        partial.replace(final)
        sync_folder(final.parent)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


@contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder next to `path`; move it into place if the block succeeds.

    `path`: the new folder; its parent folder must exist.
    Raises `InputError` if `path` exists, or its parent folder doesn't.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "set"
    >>> with atomic_folder(folder) as partial:
    ...     _ = (partial / "note.txt").write_text("whole")
    >>> (folder / "note.txt").read_text()
    'whole'
    """
    final = Path(path)
    if final.exists():
        raise InputError(f"{final}: already exists and is not overwritten; choose another name")
    if not final.parent.is_dir():
        raise InputError(f"{final}: the folder {final.parent} does not exist; create it first")
    partial = Path(tempfile.mkdtemp(prefix=f".{final.name}-", dir=final.parent))
    try:
        yield partial
        readable = _file_mode(final)
        partial.chmod(readable | ((readable & 0o444) >> 2))
        partial.rename(final)
        sync_folder(final.parent)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def _file_mode(final: Path) -> int:
    """Return the mode of a file, or the default mode of a new file."""
    try:
        return final.stat().st_mode & 0o777
    except FileNotFoundError:
        umask = os.umask(0)
        os.umask(umask)
        return 0o666 & ~umask


def sync_folder(folder: Path) -> None:
    """Flush a folder's entries to disk, so a new file survives a power failure.

    Windows can't open folders, and writes the entries itself.
    """
    if sys.platform != "win32":
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def check_not_input(output: Path, *, inputs: Iterable[Path]) -> None:
    """Refuse an output file that is also an input.

    Raises `InputError` if `output` is the same file as an input, even under another name.

    >>> import tempfile
    >>> holds = Path(tempfile.mkdtemp()) / "holds.csv"
    >>> _ = holds.write_text("hold_id,time_s,value")
    >>> check_not_input(holds.with_name("answers.csv"), inputs=[holds])
    >>> check_not_input(holds, inputs=[holds])
    Traceback (most recent call last):
    palpate.errors.InputError: ...holds.csv is an input and would be lost; choose another name
    """
    if output.exists() and any(path.exists() and output.samefile(path) for path in inputs):
        raise InputError(f"{output} is an input and would be lost; choose another name")


def check_writable(output: Path) -> None:
    """Check early that an output file can be written later.

    Raises `InputError` if `output` is a folder, or its parent folder is missing or read-only.

    >>> check_writable(Path("no-such-folder/pad.json"))
    Traceback (most recent call last):
    palpate.errors.InputError: no-such-folder/pad.json: the folder no-such-folder does not exist; \
create it first
    """
    folder = output.parent
    try:
        output.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:  # too long, or with NUL
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{str(output)!r}: {why}; choose another name") from error
    if output.is_dir():
        raise InputError(f"{output} is a folder; name a file")
    if not folder.is_dir():
        raise InputError(f"{output}: the folder {folder} does not exist; create it first")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{output}: no permission to write to {folder}; choose another folder")


def check_new(output: Path, *, option: str = "--out") -> None:
    """Check early that an output file is new and can be written later.

    Raises `InputError` if the file exists, or `check_writable` refuses it.
    """
    check_writable(output)
    if output.exists():
        raise InputError(
            f"{output}: already exists and is not overwritten; choose another {option}"
        )


def escape_csv_cell(value: object) -> object:
    """Return a cell for a CSV file, with spreadsheet formulas quoted.

    Users type the names of items, holds and files. A leading apostrophe makes them text in Excel,
    LibreOffice and Google Sheets (OWASP, "CSV Injection").

    >>> escape_csv_cell("=HYPERLINK(A1)"), escape_csv_cell("A17"), escape_csv_cell(-1.5)
    ("'=HYPERLINK(A1)", 'A17', -1.5)
    """
    is_formula = isinstance(value, str) and value.lstrip(" ")[:1] in _FORMULA_STARTS
    return f"'{value}" if is_formula else value


def load_json(text: str) -> Any:
    """Parse a JSON file with stricter rules than Python's reader.

    Raises `ValueError` if the text is not JSON, contains NaN or Infinity, which JSON does not know,
    or names a key twice, of which one would be lost.

    >>> load_json('{"a": 1, "a": 2}')
    Traceback (most recent call last):
    ValueError: the key 'a' occurs twice
    """
    return json.loads(text, parse_constant=_refuse_constant, object_pairs_hook=_unique_keys)


def _refuse_constant(name: str) -> Any:
    raise ValueError(f"{name} is not a number")


def _unique_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in pairs:
        if name in found:
            raise ValueError(f"the key {name!r:.40} occurs twice")
        found[name] = value
    return found


def load_dataclass(kind: type[T], stored: object, *, where: str = "") -> T:
    """Return a dataclass from plain values with strict checks.

    Integers become floats and lists become tuples; no other value is converted, and unknown names
    are refused. A field with a default may be missing, because older files lack newer fields.

    `kind`: a dataclass whose fields are numbers, strings, booleans, literals, tuples, mappings
        with string keys, other such dataclasses, or unions of these with None.
    `stored`: plain values from a file.
    `where`: place of the values in the file, for messages; empty for the whole file.
    Raises `InputError` if a name is missing or unknown, or a value is infinite, NaN or of another
    type. Integers must be 0 or more.

    >>> from palpate.signal.circuit import Divider
    >>> load_dataclass(Divider, {"adc_bits": 12}).adc_bits
    12
    >>> try:
    ...     load_dataclass(Divider, {"adc_bits": "ten"}, where="layout.divider")
    ... except InputError as error:
    ...     print(error)
    layout.divider.adc_bits is 'ten', not a count
    """
    stored = _require_table(stored, where=where)
    by_name = {field.name: field for field in fields(kind) if field.init}  # type: ignore[arg-type]
    needed = (n for n, f in by_name.items() if f.default is f.default_factory is MISSING)
    faults = {
        "lacks {}": sorted(set(needed) - set(stored)),
        "has unknown keys: {}": sorted(set(stored) - set(by_name)),
    }
    if any(faults.values()):
        fault = " and ".join(
            text.format(", ".join(names)) for text, names in faults.items() if names
        )
        hint = "; units are part of the names" if set(stored) - set(by_name) else ""
        raise InputError(f"{where or 'the file'} {fault}{hint}")
    hints = get_type_hints(kind)
    return kind(
        **{name: _convert(hints[name], stored[name], _join_place(where, name)) for name in stored}
    )


def _convert(kind: Any, stored: Any, where: str) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any:
        return stored
    if is_dataclass(kind):
        return load_dataclass(kind, stored, where=where)  # type: ignore[arg-type]
    if origin is UnionType:
        (other,) = (part for part in parts if part is not NoneType)
        return None if stored is None else _convert(other, stored, where)
    if origin is tuple:
        return _convert_list(parts, stored, where)
    if origin is Mapping:
        table = _require_table(stored, where=where)
        return {
            name: _convert(parts[1], value, _join_place(where, name))
            for name, value in table.items()
        }
    if origin is Literal and stored not in parts:
        raise InputError(f"{where} is {stored!r:.40}; it must be one of {', '.join(parts)}")
    if kind is float:
        # Rejects NaN, infinity, and integers too large for a float.
        if type(stored) not in (int, float) or not abs(stored) <= _LARGEST:
            raise InputError(f"{where} is {stored!r:.40}, not a finite number")
        return float(stored)
    if kind is int and (type(stored) is not int or not 0 <= stored < 2**63):
        raise InputError(f"{where} is {stored!r:.40}, not a count")
    if kind is str and not isinstance(stored, str):
        raise InputError(f"{where} is {stored!r:.40}, not text")
    if kind is bool and not isinstance(stored, bool):
        raise InputError(f"{where} is {stored!r:.40}, not true or false")
    return stored


def _convert_list(parts: tuple[Any, ...], stored: Any, where: str) -> tuple[Any, ...]:
    what = " of numbers" if parts[0] in (int, float) else ""
    if not isinstance(stored, list | tuple):
        raise InputError(f"{where} must be a list{what}")
    if parts[-1] is not ... and len(stored) != len(parts):
        raise InputError(f"{where} must be a list of {len(parts)}")
    return tuple(_convert(parts[0], value, where) for value in stored)


def _require_table(stored: Any, *, where: str) -> Mapping[str, Any]:
    if not isinstance(stored, dict):
        raise InputError(f"{where or 'the file'} is {stored!r:.40}, not a table")
    return stored


def _join_place(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name
