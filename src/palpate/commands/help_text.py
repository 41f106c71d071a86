"""Help that reads: docstrings that flow to the terminal's width, and placeholders in words."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import typer

#: What stands for a value of this type where a command names nothing better.
_PLACEHOLDERS: dict[object, str] = {int: "N", float: "NUMBER", str: "TEXT", Path: "FILE"}


def help_text(function: Callable[..., Any]) -> str:
    """Return the docstring without the line ends inside its paragraphs.

    Typer unwraps the first paragraph alone, so the others would break where the source does.

    Examples
    --------
    >>> def grasp() -> None:
    ...     '''Close on it.
    ...
    ...     Then give it
    ...     back.
    ...     '''
    >>> help_text(grasp)
    'Close on it.\\n\\nThen give it back.'
    """
    # The list of commands shows the first paragraph, which an example would clutter.
    paragraphs = (
        (inspect.getdoc(function) or "").replace(" Example: ", "\n\nExample: ").split("\n\n")
    )
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def readable(command: Any) -> Any:
    """Return a command whose options without a placeholder have one in words, and switches none.

    Typer would print the Python type: `--json <bool>`, `--cutoff <list[float]>`.
    """
    for nested in getattr(command, "commands", {}).values():
        readable(nested)
    # The option --help is made at first use, and kept.
    context = typer.Context(command)
    for parameter in (*command.params, command.get_help_option(context)):
        if parameter is None or parameter.metavar is not None:
            continue
        annotation = parameter.type_descriptor.annotation
        element = next(iter(get_args(annotation)), annotation)
        if parameter.param_type_name == "argument":
            parameter.metavar = parameter.name.upper()
        elif parameter.is_flag:
            parameter.metavar = ""
        elif element in _PLACEHOLDERS:
            parameter.metavar = _PLACEHOLDERS[element]
    return command
