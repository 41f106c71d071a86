"""Groups of commands whose modules are loaded on first use."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple

import typer
from typer.core import TyperCommand, TyperGroup

from palpate.errors import InputError

#: Markdown wraps help paragraphs to the terminal's width and prints brackets literally.
HELP: Any = "markdown"
#: Entry-point group in which palpate's own packages register verbs.
GROUP = "palpate.verbs"


class LazyCommand(NamedTuple):
    """The entry of a command whose module is not loaded yet."""

    #: `module:name` of the command's function, or of a mapping of subcommands.
    place: str
    #: One line for the list of commands.
    summary: str
    #: Heading in the list of commands.
    heading: str | None = None
    #: The package that registers the command as an entry point, and its folder in the source.
    package: tuple[str, str] | None = None


class LazyGroup(TyperGroup):
    """A group of commands by name and summary; loads only the requested command."""

    def add_entries(self, entries: Mapping[str, LazyCommand]) -> None:
        """Add commands without loading them."""
        for name, (_, summary, heading, _) in entries.items():
            self.commands[name] = TyperCommand(
                name=name, help=summary, rich_help_panel=heading, rich_markup_mode=HELP
            )
        self._entries: dict[str, LazyCommand] = {**entries}

    def load(self, name: str) -> Any:
        """Load and return a command.

        Raises `InputError` if the command's package is not installed.
        """
        if name in self._entries:
            self.commands[name] = load_command(name, self._entries.pop(name))
        return self.commands[name]

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Load the requested command."""
        if args[0] in self.commands:
            self.load(args[0])
        return super().resolve_command(ctx, args)


def load_command(name: str, entry: LazyCommand) -> Any:
    """Load a command or a group of commands.

    Raises `InputError` if the command's package is not installed.
    """
    place = entry.place
    if entry.package is not None:
        place = find_entry_point(GROUP, name, *entry.package, wanted=f"palpate {name}").value
    module_name, _, attribute = place.partition(":")
    module = importlib.import_module(module_name)
    found = getattr(module, attribute)
    if isinstance(found, Mapping):
        text = f"{entry.summary}\n\nExample: palpate {name} {next(iter(found))} --help"
        group = LazyGroup(name=name, help=text, no_args_is_help=True, rich_markup_mode=HELP)
        group.add_entries({step: LazyCommand(*row) for step, row in found.items()})
        return group
    app = typer.Typer(add_completion=False, rich_markup_mode=HELP)
    app.command(name=name, **getattr(module, "SETTINGS", {}))(found)
    return typer.main.get_command(app)


def find_entry_point(
    group: str, name: str, package: str, folder: str, *, wanted: str
) -> EntryPoint:
    """Return the entry point of one of palpate's own packages.

    `wanted`: the command or option that requires the package, for the message.
    Raises `InputError` if the package is not installed.
    """
    for point in entry_points(group=group):
        if point.name == name:
            return point
    raise InputError(
        f"{wanted} requires the package {package}; in a copy of the source: pip install ./{folder}"
    )
