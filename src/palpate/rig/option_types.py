"""Options in a rig file for an opener, checked against the opener's own signature."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

_WORDS: Mapping[Any, str] = {
    str: "text in quotes",
    int: "a whole number",
    float: "a finite number",
    bool: "true or false",
}


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
