"""Tables for the studies from clones of the repositories in which others published recordings."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli.options import JsonOption
from palpate.errors import InputError
from palpate_studies.raw import fruit, holds, velostat
from palpate_studies.raw.clone import Clone


@dataclass(frozen=True, slots=True, kw_only=True)
class Source:
    """Recordings in a public repository, and how they become tables.

    Attributes
    ----------
    repository, commit : str
        On GitHub; the commit that was read, empty for the head.
    marks : tuple of str
        A clone holds the recordings where a path begins with one of these; without any, the name
        of its folder decides.
    write : callable
        From a clone and a folder to the files written, with their rows.
    """

    repository: str
    commit: str
    marks: tuple[str, ...]
    write: Callable[[Clone, Path], list[tuple[str, int]]]


SOURCES = (
    Source(
        repository="Lupasic/tactile-sensor-velostat",
        commit="5d5250765551253e1622d5c92c4124fd6e2745c4",
        marks=(velostat.STROKES,),
        write=velostat.write_strokes,
    ),
    Source(
        repository="Lupasic/tactile-sensor-velostat",
        commit="",
        marks=(velostat.LADDERS,),
        write=velostat.write_ladders,
    ),
    Source(
        repository="SheepLiu712/FruitRuptureEstimate",
        commit="",
        marks=(fruit.BANANA, fruit.KIWI, fruit.MANGO),
        write=fruit.write_fruit,
    ),
    Source(
        repository="Chongran-Zhao/VHB4910_data",
        commit="",
        marks=(holds.TAPE,),
        write=holds.write_tape,
    ),
    Source(
        repository="NMAILKAIST/deep-characterization-soft-sensor",
        commit="07c2446a6292c75f7a2a92f9408a5f2a14df9d2d",
        marks=(holds.SOFT_SENSOR,),
        write=holds.write_soft_sensor,
    ),
    Source(
        repository="richgumy/electromech-stretcher",
        commit="ab6634c8eb27df66c7206f08d8ad04d532667c87",
        marks=(),
        write=holds.write_silicone,
    ),
)


def command(
    clones: Annotated[
        list[Path], typer.Argument(help="Clones of the repositories.", metavar="CLONE...")
    ],
    out: Annotated[Path, typer.Option(help="Folder for the tables.", metavar="DIR")],
    as_json: JsonOption = False,
) -> None:
    """Turn clones of the public repositories into the tables that the studies read.

    Example: palpate study import-data tactile-sensor-velostat FruitRuptureEstimate --out data
    """
    out.mkdir(parents=True, exist_ok=True)
    written: list[dict[str, Any]] = []
    for path in clones:
        written += _import_tables(path, out)
    if as_json:
        typer.echo(json.dumps({"files": written}, indent=1))
        return
    for one in written:
        where = f"{one['repository']} at {one['commit'][:12]}"
        typer.echo(f"{out / one['file']}: {one['rows']} rows from {where}")


def _import_tables(path: Path, out: Path) -> list[dict[str, Any]]:
    """Write the tables of every source that a clone holds."""
    found: list[dict[str, Any]] = []
    for source in SOURCES:
        clone = Clone(path, commit=source.commit)
        held = any(name.startswith(source.marks) for name in clone.names)
        # The stretches of silicone lie in folders of any name: by the name of the repository.
        named = not source.marks and source.repository.split("/")[1] in path.resolve().name
        if not (held or named):
            continue
        if not clone.pinned:
            note = f"{path}: commit {source.commit[:12]} is not in this clone; its head is read"
            typer.echo(note, err=True)
        for name, rows in source.write(clone, out):
            if not rows:
                raise InputError(f"{path}: no recording for {name} at {clone.commit}")
            found.append(
                {
                    "file": name,
                    "rows": rows,
                    "repository": source.repository,
                    "commit": clone.commit,
                }
            )
    if not found:
        known = ", ".join(dict.fromkeys(source.repository for source in SOURCES))
        raise InputError(f"{path}: holds no recordings that are known; clone one of {known}")
    return found
