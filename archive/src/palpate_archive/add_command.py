"""`palpate archive add` and `compact`: what the archive holds, and in how many files."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import Annotated

import typer

from palpate.cli.options import QuietOption
from palpate.cli.progress import progress
from palpate.errors import InputError


def add(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Recordings, or folders of them.")
    ] = None,
    to: Annotated[
        Path, typer.Option(help="The archive; created if it does not exist.", metavar="DIR")
    ] = Path("archive"),
    station: Annotated[
        str | None,
        typer.Option(help="Where it was recorded. By default the rig's name; a store needs it."),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option(help="Add the grasps of this store too.", metavar="FILE_OR_URL"),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Add recordings and the grasps of a store. What the archive holds already is skipped.

    Example: palpate archive add recordings --to archive --station north
    """
    from palpate.produce.store.database import Store
    from palpate_archive.adding import add_recordings, add_store, found_recordings
    from palpate_archive.layout import Archive, check_name

    for path in files or []:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
    recordings = list(found_recordings(files or []))
    if not recordings and store is None:
        raise InputError("nothing to add: name recordings, a folder that holds some, or --store")
    if store is not None and station is None:
        raise InputError("--store: state with --station whose grasps these are")
    if station is not None:
        check_name("--station", station)
    archive = Archive(to, create=True)
    rows, fresh = Counter[str](), 0
    with progress("adding", total=len(recordings), quiet=quiet) as show:
        each = add_recordings(archive, recordings, station=station)
        for number, added in enumerate(each, start=1):
            rows.update(added)
            fresh += bool(added)
            show(number)
    if store is not None and station is not None:
        opened = Store.open(store)
        try:
            rows.update(add_store(archive, opened, station=station))
        finally:
            opened.close()
    counted = ", ".join(f"{count} rows of {kind}" for kind, count in sorted(rows.items()))
    print(
        f"{to}: {fresh} of {len(recordings)} recordings are new; added {counted or 'nothing'}",
        file=sys.stderr,
    )


def compact(
    archive: Annotated[Path, typer.Argument(help="The archive.", metavar="DIR")],
) -> None:
    """Join the files of each station and day, up to a million rows a file.

    While it runs, a query may see some rows twice: run it when nobody reads.

    Example: palpate archive compact archive
    """
    from palpate_archive.compacting import join_files as join_files
    from palpate_archive.layout import KINDS, Archive

    opened = Archive(archive)
    for kind in KINDS:
        before, after = join_files(opened, kind)
        print(f"{archive}: {kind}: {before} files became {after}", file=sys.stderr)
