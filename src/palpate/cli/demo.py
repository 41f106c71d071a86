"""`palpate demo`: a simulated grasp, or simulated example files."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.lazy_group import find_entry_point
from palpate.cli.options import filter_names, opt
from palpate.demo import DEMOS, Demo
from palpate.errors import InputError

#: Entry points of demos of other packages, each a `Demo`.
ENTRY_POINTS = "palpate.demos"
#: Demos of palpate's own packages, for the message if the package is not installed.
_PACKAGES = {"packhouse": ("palpate-station", "packages/station")}


def demo_names() -> list[str]:
    """Return the names of the installed demos."""
    return [*DEMOS, *(point.name for point in entry_points(group=ENTRY_POINTS))]


def _complete(incomplete: str) -> Iterator[str]:
    yield from filter_names(demo_names(), incomplete)


def demo(
    name: Annotated[
        str,
        typer.Argument(
            help="grasp, recordings, force, packhouse or so101.", autocompletion=_complete
        ),
    ] = "grasp",
    out: Annotated[Path | None, opt("--out DIR", "Output folder. [default: demo-NAME]")] = None,
) -> None:
    """Show a simulated grasp, write simulated example files, or simulate a robot's ports.

    grasp: a grasp in the terminal, its picture and its recording. recordings: data-logger files.
    force: readings with known loads. packhouse: an item store with sorting rules, in about 15 s.
    so101: servo line and sensor of an SO-101 with a rig file, until Ctrl-C.

    All data are simulated and labelled as such.

    Example: palpate demo
    """
    chosen = find_demo(name)
    folder = out if out is not None else Path(chosen.folder)
    commands = [one.replace(chosen.folder, str(folder)) for one in chosen.commands]
    if chosen.is_running:
        chosen.load()(folder, commands)
        return
    written = chosen.load()(folder)
    print("Written, simulated: " + ", ".join(map(str, written)))
    print("Try:")
    for command in commands:
        print("  " + command)


def find_demo(name: str) -> Demo:
    """Return a demo of the core or of an installed package.

    Raises `InputError` if there is none of this name, or its package is not installed.
    """
    if name in DEMOS:
        return DEMOS[name]
    for point in entry_points(group=ENTRY_POINTS, name=name):
        found: Demo = point.load()
        return found
    if name in _PACKAGES:
        find_entry_point(ENTRY_POINTS, name, *_PACKAGES[name], wanted=f"palpate demo {name}")
    raise InputError(f"no demo {name!r}; available: {', '.join(demo_names())}")
