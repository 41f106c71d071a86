"""Help that reads: docstrings that flow to the terminal's width, and placeholders in words."""

from __future__ import annotations

import inspect
import re
import shutil
import textwrap
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import typer

#: Placeholder of a value of this type where a command names nothing better.
_PLACEHOLDERS: dict[object, str] = {int: "N", float: "NUMBER", str: "TEXT", Path: "FILE"}
#: End of a parameter's name -> its placeholder.
_UNITS = {
    "_s": "SECONDS",
    "_mm": "MM",
    "_n": "NEWTONS",
    "_percent": "PERCENT",
    "_ohm": "OHM",
    "_hz": "HZ",
    "_deg": "DEGREES",
    "_c": "CELSIUS",
}
#: What Rich would take for a style, and swallow.
_TAG = re.compile(r"\[[a-z#/@][^\[\]]*\]")


def help_text(function: Callable[..., Any]) -> str:
    """Return the docstring without the line ends inside its paragraphs.

    Typer unwraps the first paragraph alone, so the others would break where the source does.

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
    return _literal("\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs))


def listed(summaries: Mapping[str, str]) -> str:
    """Return names with their summaries next to them, as wide as the terminal.

    >>> print(listed({"rest": "Nothing on it", "force": "Newtons"}))
      rest   Nothing on it
      force  Newtons
    """
    indent = max(map(len, summaries)) + 4
    width = shutil.get_terminal_size().columns
    return "\n".join(
        textwrap.fill(f"  {name:<{indent - 4}}  {summary}", width, subsequent_indent=" " * indent)
        for name, summary in summaries.items()
    )


def readable(command: Any) -> Any:
    """Return a command whose options without a placeholder have one in words, and switches none.

    Typer would print the Python type: `--json <bool>`, `--cutoff <list[float]>`.
    """
    for nested in getattr(command, "commands", {}).values():
        readable(nested)
    # The option --help is made at first use, and kept.
    context = typer.Context(command)
    for parameter in (*command.params, command.get_help_option(context)):
        if parameter is None:
            continue
        parameter.help = _literal(parameter.help or "")
        if parameter.param_type_name == "argument":
            parameter.metavar = parameter.metavar or parameter.name.upper()
            # Otherwise its type is shown next to the name.
            parameter.display_type_rich = _no_type
        elif parameter.metavar is None:
            parameter.metavar = _placeholder(parameter)
    return command


def _placeholder(option: Any) -> str | None:
    if option.is_flag:
        return ""
    annotation = option.type_descriptor.annotation
    element = next(iter(get_args(annotation)), annotation)
    if element is float:
        for ending, unit in _UNITS.items():
            if option.name.endswith(ending):
                return unit
    for choice in (annotation, element):
        if get_origin(choice) is Literal:
            return "|".join(get_args(choice))
    return _PLACEHOLDERS.get(element)


def _no_type(ctx: Any) -> None:
    """Show no type of a parameter."""


def _literal(text: str) -> str:
    """Return help whose square brackets are printed as they are."""
    return _TAG.sub(lambda found: "\\" + found[0], text)
