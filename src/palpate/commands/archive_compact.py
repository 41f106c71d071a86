"""`palpate archive compact DIR`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer


def command(
    archive: Annotated[Path, typer.Argument(help="The archive.", metavar="DIR")],
) -> None:
    """Join the files of each station and day, up to a million rows a file.

    While it runs, a query may see some rows twice: run it when nobody reads.

    Example: palpate archive compact archive
    """
    from palpate.archive.compacting import compact
    from palpate.archive.layout import KINDS, Archive

    opened = Archive(archive)
    for kind in KINDS:
        before, after = compact(opened, kind)
        print(f"{archive}: {kind}: {before} files became {after}", file=sys.stderr)
