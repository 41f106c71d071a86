"""Convert recordings in clones of public repositories into the tables of the studies."""

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
    """Recordings in a public repository, and their conversion to tables.

    Attributes
    ----------
    repository, commit : str
        Name on GitHub, and the commit to read; empty for the head.
    marks : tuple of str
        Path prefixes that identify the recordings in a clone. Without prefixes, the name of the
        clone's folder identifies them.
    write : callable
        From a clone and a folder to the written files with their numbers of rows.
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
    """Convert clones of the public repositories into the tables of the studies.

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
    """Write the tables of every source found in a clone."""
    found: list[dict[str, Any]] = []
    for source in SOURCES:
        clone = Clone(path, commit=source.commit)
        held = any(name.startswith(source.marks) for name in clone.names)
        # Folders of the silicone recordings have arbitrary names, so the clone's name decides.
        named = not source.marks and source.repository.split("/")[1] in path.resolve().name
        if not (held or named):
            continue
        if not clone.pinned:
            note = f"{path}: commit {source.commit[:12]} is not in this clone; reading its head"
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
        raise InputError(f"{path}: contains no known recordings; clone one of {known}")
    return found
