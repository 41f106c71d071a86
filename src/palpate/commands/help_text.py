"""A command's docstring as its help: paragraphs that flow to whatever width the terminal has."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any


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
    paragraphs = (inspect.getdoc(function) or "").split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)
