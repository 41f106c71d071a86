"""Fill the pages of docs/api with names, one line and an example: `python docs/generate_api.py`.

On the site, `:::` lines become the whole documentation of a name. On a forge they are plain text,
so each is followed by the first line of the docstring, the public methods, and an example: the
first of the docstring, that of `api_examples.py`, or the first one that uses the name. The site
leaves this text out. With --check nothing is written; the exit status is 1 if a page differs.
"""

from __future__ import annotations

import doctest
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

PAGES = Path(__file__).resolve().parent / "api"
sys.path.insert(0, str(PAGES.parent))
from api_examples import EXAMPLES  # noqa: E402
from generated import update_pages  # noqa: E402

BEGIN, END = "<!-- from the docstring -->", "<!-- end of docstring -->"
#: A `:::` line with its options, and the text of an earlier run.
_ENTRY = re.compile(
    rf"^::: (?P<name>[\w.]+)\n(?P<options>(?:    [^\n]*\n)*)(?:\n{BEGIN}\n.*?{END}\n)?", re.M | re.S
)


def find_object(name: str) -> Any:
    """Return the object of a dotted name, in the longest module that can be imported."""
    module, _, attribute = name.rpartition(".")
    try:
        return getattr(import_module(module), attribute)
    except AttributeError:
        return import_module(name)


def describe(name: str) -> str:
    """Return a name as Markdown: signature, first line, example, and public members."""
    found = find_object(name)
    if inspect.ismodule(found):
        rows = [
            f"- `{key}`: {_first_line(value)}"
            for key, value in vars(found).items()
            if inspect.isclass(value) and value.__module__ == found.__name__
        ]
        return "\n".join(rows)
    lines = [f"**`{name}{_arguments(found)}`**: {_first_line(found)}"]
    members = [*_members(found)] if inspect.isclass(found) else []
    if members:
        lines += ["", *(f"- `{key}`: {text}" for key, text in members)]
    example = _first_example(found)
    for names, text in EXAMPLES:
        if name in names[1:]:
            return "\n".join([*lines, "", f"Example: at `{names[0]}`."])
        if name == names[0]:
            example = text.rstrip("\n")
    if not example:
        word = name.rpartition(".")[2]
        using = (_first_example(other, word) for other in _documented())
        example = next(filter(None, using), "")
    if example:
        lines += ["", "```pycon", example, "```"]
    return "\n".join(lines)


def _arguments(found: Any) -> str:
    if inspect.isclass(found):
        return ""
    names = [
        ("*" * (one.kind is one.VAR_POSITIONAL) + "**" * (one.kind is one.VAR_KEYWORD)) + key
        for key, one in inspect.signature(found).parameters.items()
    ]
    return f"({', '.join(names)})"


def _first_line(found: Any) -> str:
    text = (inspect.getdoc(found) or "").partition("\n\n")[0]
    return " ".join(text.split())


def _members(found: type) -> Iterator[tuple[str, str]]:
    for key, value in vars(found).items():
        function = value.fget if isinstance(value, property) else value
        function = getattr(function, "__func__", function)
        if key.startswith("_") or not inspect.isfunction(function):
            continue
        yield (
            key if isinstance(value, property) else f"{key}{_method(function)}",
            _first_line(function),
        )


def _method(function: Any) -> str:
    names = [key for key in inspect.signature(function).parameters if key not in ("self", "cls")]
    return f"({', '.join(names)})"


def _first_example(found: Any, using: str = "") -> str:
    """Return the first example of a docstring, or of a method, that uses a word; "" for none."""
    places = [found, *(vars(found).values() if inspect.isclass(found) else ())]
    for place in places:
        text = inspect.getdoc(getattr(place, "__func__", place)) or ""
        lines: list[str] = []
        for example in doctest.DocTestParser().get_examples(text):
            first, *rest = example.source.rstrip("\n").split("\n")
            lines += [f">>> {first}", *(f"... {line}".rstrip() for line in rest)]
            if example.want and re.search(rf"\b{using}\b", "\n".join(lines)):
                return "\n".join([*lines, example.want.rstrip("\n")])
        if lines and not using:
            return "\n".join(lines)
    return ""


@cache
def _documented() -> tuple[Any, ...]:
    """Return all objects of the pages, and the modules of the public names."""
    names = [entry["name"] for page in sorted(PAGES.glob("*.md")) for entry in _entries(page)]
    objects = [find_object(name) for name in names]
    modules = {inspect.getmodule(one) for one in objects}
    functions = [
        value
        for module in modules
        for value in vars(module).values()
        if inspect.isfunction(value) and value.__module__ == module.__name__
    ]
    return (*objects, *sorted(functions, key=lambda one: one.__qualname__))


def _entries(page: Path) -> list[re.Match[str]]:
    return [*_ENTRY.finditer(page.read_text(encoding="utf-8"))]


def fill_page(page: str) -> str:
    """Return a page with current descriptions."""
    return _ENTRY.sub(
        lambda entry: (
            f"::: {entry['name']}\n{entry['options']}\n{BEGIN}\n\n"
            f"{describe(entry['name'])}\n\n{END}\n"
        ),
        page,
    )


if __name__ == "__main__":
    sys.exit(update_pages(PAGES, fill_page))
