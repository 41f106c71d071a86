"""Plain values, as JSON gives them, into dataclasses; what does not fit is named by its place.

Strict: no value is converted but whole numbers into floats, no name is skipped. A field with a
default may be missing: files older than it lack it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from palpate.errors import InputError

T = TypeVar("T")
_LARGEST = 1e300


def structured(kind: type[T], stored: object, *, where: str = "") -> T:
    """Return the dataclass that was stored as plain values.

    `kind`: a dataclass whose fields are numbers, text, truth values, literals, tuples, mappings
        with text as keys, other such dataclasses, or one of these or None.
    `stored`: what a file holds of it.
    `where`: the name of its place in the file; empty for the whole file.
    Raises `InputError` if a name is missing or unknown, or a value is of another type; one line
    that names it.

    >>> from palpate.signal.circuit import Divider
    >>> structured(Divider, {"adc_bits": 12}).adc_bits
    12
    >>> try:
    ...     structured(Divider, {"adc_bits": "ten"}, where="layout.divider")
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
        return structured(kind, stored, where=where)  # type: ignore[arg-type]
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
        return _number(stored, where)
    if kind is int and (type(stored) is not int or not 0 <= stored < 2**63):
        raise InputError(f"{where} is {stored!r:.40}, not a count")
    if kind is str and not isinstance(stored, str):
        raise InputError(f"{where} is {stored!r:.40}, not text")
    return stored


def _number(stored: Any, where: str) -> float:
    # Not a number, infinite, or a whole number too large for a float.
    if type(stored) not in (int, float) or not abs(stored) <= _LARGEST:
        raise InputError(f"{where} is {stored!r:.40}, not a finite number")
    return float(stored)


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
