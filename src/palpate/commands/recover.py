"""`palpate recover IN [OUT]`: make a cut or damaged recording whole for strict readers."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from palpate.errors import RecordingError


def recover(
    file: Annotated[Path, typer.Argument(help="A recording that was cut short or damaged.")],
    out: Annotated[
        Path | None, typer.Argument(help="Where to write; without it, FILE is replaced.")
    ] = None,
) -> None:
    """Keep every intact message of a recording in a finished file.

    palpate itself reads a cut recording as it is; other tools may not.

    Example: palpate recover run.mcap run-whole.mcap
    """
    from palpate.recording import recover as recover_file

    if out is not None and out.exists() and not (file.exists() and out.samefile(file)):
        raise RecordingError(f"{out}: exists already and is not overwritten; choose another name")
    found = recover_file(file, out or file)
    if found.intact:
        print(f"{file} was whole already; written to {out or file}")
        return
    print(
        f"{out or file}: everything readable is kept "
        f"({found.damaged_chunks} damaged chunks and {found.unread_bytes} bytes at the end are not)"
    )
