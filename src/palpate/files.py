"""Files are written whole or not at all, and what JSON holds becomes dataclasses."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from palpate.errors import InputError

#: What begins a formula in a spreadsheet, or hides its beginning.
_FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r", "\n")
#: Larger numbers are no quantity.
_LARGEST = 1e300

T = TypeVar("T")


@contextmanager
def atomic_path(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path next to `path`; move it into place if the block succeeds.

    `path`: where the finished file goes. Its folder must exist.
    Yields a file in the same folder and with the same ending, for the block to write.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> with atomic_path(folder / "note.txt") as partial:
    ...     _ = partial.write_text("whole")
    >>> [p.name for p in folder.iterdir()], (folder / "note.txt").read_text()
    (['note.txt'], 'whole')
    """
    # Through a link to what it names: the link stays.
    final = Path(path).resolve()
    try:
        handle, name = tempfile.mkstemp(
            prefix=f".{final.stem}-", suffix="".join(final.suffixes), dir=final.parent
        )
    except OSError as error:
        # The user knows the file asked for, not the temporary one.
        raise OSError(error.errno, error.strerror, str(path)) from error
    os.close(handle)
    partial = Path(name)
    try:
        yield partial
        with partial.open("rb") as written:
            os.fsync(written.fileno())
        partial.chmod(_mode(final))
        partial.replace(final)
        sync_folder(final.parent)
    except BaseException:
        partial.unlink(missing_ok=True)
        raise


@contextmanager
def atomic_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder next to `path`; move it into place if the block succeeds.

    `path`: the new folder; its own folder must exist.
    Raises `InputError` if it is there already, or its folder is not.

    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp()) / "set"
    >>> with atomic_folder(folder) as partial:
    ...     _ = (partial / "note.txt").write_text("whole")
    >>> (folder / "note.txt").read_text()
    'whole'
    """
    final = Path(path)
    if final.exists():
        raise InputError(f"{final}: exists already and is not overwritten; choose another name")
    if not final.parent.is_dir():
        raise InputError(f"{final}: there is no folder {final.parent}; make it first")
    partial = Path(tempfile.mkdtemp(prefix=f".{final.name}-", dir=final.parent))
    try:
        yield partial
        readable = _mode(final)
        partial.chmod(readable | ((readable & 0o444) >> 2))
        partial.rename(final)
        sync_folder(final.parent)
    except BaseException:
        shutil.rmtree(partial, ignore_errors=True)
        raise


def _mode(final: Path) -> int:
    """Return the mode that a file has, or that a new one would get."""
    try:
        return final.stat().st_mode & 0o777
    except FileNotFoundError:
        umask = os.umask(0)
        os.umask(umask)
        return 0o666 & ~umask


def sync_folder(folder: Path) -> None:
    """Flush a folder's entries to disk, so that a new file survives a power cut."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def keep_inputs(output: Path, *, inputs: Iterable[Path]) -> None:
    """Refuse to write over what is read.

    Raises `InputError` if they are one file, under whatever names.

    >>> import tempfile
    >>> holds = Path(tempfile.mkdtemp()) / "holds.csv"
    >>> _ = holds.write_text("hold_id,time_s,value")
    >>> keep_inputs(holds.with_name("answers.csv"), inputs=[holds])
    >>> keep_inputs(holds, inputs=[holds])
    Traceback (most recent call last):
    palpate.errors.InputError: ...holds.csv is read here and would be lost; choose another name
    """
    if output.exists() and any(path.exists() and output.samefile(path) for path in inputs):
        raise InputError(f"{output} is read here and would be lost; choose another name")


def check_place(output: Path) -> None:
    """Refuse, before the work, a file that could not be written after it.

    Raises `InputError` if it is a folder, or its own folder is not there or can't be written to.

    >>> check_place(Path("no-such-folder/pad.json"))
    Traceback (most recent call last):
    palpate.errors.InputError: no-such-folder/pad.json: there is no folder no-such-folder; \
make it first
    """
    folder = output.parent
    if output.is_dir():
        raise InputError(f"{output} is a folder; name a file")
    if not folder.is_dir():
        raise InputError(f"{output}: there is no folder {folder}; make it first")
    if not os.access(folder, os.W_OK):
        raise InputError(f"{output}: no right to write to {folder}; choose another place")


def check_new(output: Path, *, option: str = "--out") -> None:
    """Refuse, before the work, to write over a file, or where `check_place` refuses.

    Raises `InputError` if the file exists already.
    """
    check_place(output)
    if output.exists():
        raise InputError(
            f"{output}: exists already and is not overwritten; choose another {option}"
        )


def csv_cell(value: object) -> object:
    """Return a cell for a CSV file; text that spreadsheets run as formula is quoted.

    Names of items, holds and files are typed by people. A leading apostrophe makes them
    text in Excel, LibreOffice and Google Sheets (OWASP, "CSV Injection").

    >>> csv_cell("=HYPERLINK(A1)"), csv_cell("A17"), csv_cell(-1.5)
    ("'=HYPERLINK(A1)", 'A17', -1.5)
    """
    is_formula = isinstance(value, str) and value.lstrip(" ")[:1] in _FORMULA_STARTS
    return f"'{value}" if is_formula else value


def structure(kind: type[T], stored: object, *, where: str = "") -> T:
    """Return the dataclass that was stored as plain values, or name what does not fit.

    Strict: no value is converted but whole numbers into floats, no name is skipped. A field with a
    default may be missing: files older than it lack it.

    `kind`: a dataclass whose fields are numbers, text, truth values, literals, tuples, mappings
        with text as keys, other such dataclasses, or one of these or None.
    `stored`: what a file holds of it.
    `where`: the name of its place in the file; empty for the whole file.
    Raises `InputError` if a name is missing or unknown, or a value is of another type.

    >>> from palpate.signal.circuit import Divider
    >>> structure(Divider, {"adc_bits": 12}).adc_bits
    12
    >>> try:
    ...     structure(Divider, {"adc_bits": "ten"}, where="layout.divider")
    ... except InputError as error:
    ...     print(error)
    layout.divider.adc_bits is 'ten', not a count
    """
    stored = _table(stored, where=where)
    there = {field.name: field for field in fields(kind) if field.init}  # type: ignore[arg-type]
    needed = (n for n, f in there.items() if f.default is f.default_factory is MISSING)
    faults = {
        "lacks {}": sorted(set(needed) - set(stored)),
        "has {}, which is not known": sorted(set(stored) - set(there)),
    }
    if any(faults.values()):
        fault = " and ".join(
            text.format(", ".join(names)) for text, names in faults.items() if names
        )
        raise InputError(f"{where or 'the file'} {fault}; units are part of the names")
    hints = get_type_hints(kind)
    return kind(**{name: _value(hints[name], stored[name], _in(where, name)) for name in stored})


def _value(kind: Any, stored: Any, where: str) -> Any:
    origin, parts = get_origin(kind), get_args(kind)
    if kind is Any:
        return stored
    if is_dataclass(kind):
        return structure(kind, stored, where=where)  # type: ignore[arg-type]
    if origin is UnionType:
        (other,) = (part for part in parts if part is not NoneType)
        return None if stored is None else _value(other, stored, where)
    if origin is tuple:
        return _list(parts, stored, where)
    if origin is Mapping:
        table = _table(stored, where=where)
        return {name: _value(parts[1], value, _in(where, name)) for name, value in table.items()}
    if origin is Literal and stored not in parts:
        raise InputError(f"{where} is {stored!r:.40}, none of {', '.join(parts)}")
    if kind is float:
        # Not a number, infinite, or a whole number too large for a float.
        if type(stored) not in (int, float) or not abs(stored) <= _LARGEST:
            raise InputError(f"{where} is {stored!r:.40}, not a finite number")
        return float(stored)
    if kind is int and (type(stored) is not int or not 0 <= stored < 2**63):
        raise InputError(f"{where} is {stored!r:.40}, not a count")
    if kind is str and not isinstance(stored, str):
        raise InputError(f"{where} is {stored!r:.40}, not text")
    return stored


def _list(parts: tuple[Any, ...], stored: Any, where: str) -> tuple[Any, ...]:
    what = " of numbers" if parts[0] in (int, float) else ""
    if not isinstance(stored, list | tuple):
        raise InputError(f"{where} must be a list{what}")
    if parts[-1] is not ... and len(stored) != len(parts):
        raise InputError(f"{where} must be a list of {len(parts)}")
    return tuple(_value(parts[0], value, where) for value in stored)


def _table(stored: Any, *, where: str) -> Mapping[str, Any]:
    if not isinstance(stored, dict):
        raise InputError(f"{where or 'the file'} is {stored!r:.40}, not a table")
    return stored


def _in(where: str, name: str) -> str:
    return f"{where}.{name}" if where else name
