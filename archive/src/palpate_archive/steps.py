"""The commands of `palpate archive`, registered through an entry point."""

from __future__ import annotations

import sys
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from palpate.cli import options as option
from palpate.cli.options import HorizonOption, QuietOption
from palpate.cli.output import progress
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate_archive.evaluating import Job

#: Command -> (location, description).
STEPS = {
    "add": (f"{__name__}:add", "Add recordings and the grasps of a store"),
    "compact": (f"{__name__}:compact", "Join the small files of each day"),
    "settle": (f"{__name__}:settle", "Predict the settled value of every hold"),
    "recalibrate": (f"{__name__}:recalibrate", "Estimate the force of every frame"),
}
ArchiveArgument: TypeAlias = Annotated[Path, typer.Argument(help="The archive.", metavar="DIR")]
ToOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--to", help="Folder of the results. [default: results, in the archive]", metavar="DIR"
    ),
]


def add(
    files: Annotated[
        list[Path] | None, typer.Argument(help="Recordings, or folders of them.")
    ] = None,
    to: Annotated[
        Path, typer.Option(help="The archive; created if it does not exist.", metavar="DIR")
    ] = Path("archive"),
    station: Annotated[
        str | None,
        typer.Option(
            help="Place of the recordings; default: name of the rig. Required with --store."
        ),
    ] = None,
    store: Annotated[
        str | None,
        typer.Option(help="Add the grasps of this store too.", metavar="FILE_OR_URL"),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Add recordings and the grasps of a store; skip those already in the archive.

    Example: palpate archive add recordings --to archive --station north
    """
    from palpate.produce.store.database import Store
    from palpate_archive.adding import add_recordings, add_store, find_recordings
    from palpate_archive.layout import Archive, check_name

    for path in files or []:
        if not path.exists():
            raise InputError(f"{path}: no such file or folder")
    recordings = list(find_recordings(files or []))
    if not recordings and store is None:
        if files:
            raise InputError(f"no recordings (.mcap) in {', '.join(map(str, files))}")
        raise InputError("nothing to add: name recordings, a folder with recordings, or --store")
    if store is not None and station is None:
        raise InputError("--store: the station of its grasps is unknown; give --station")
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
        with Store.open(store) as opened:
            rows.update(add_store(archive, opened, station=station))
    counted = ", ".join(f"{count} rows of {kind}" for kind, count in sorted(rows.items()))
    print(
        f"{to}: {fresh} of {len(recordings)} recordings are new; added {counted or 'nothing'}",
        file=sys.stderr,
    )


def compact(archive: ArchiveArgument) -> None:
    """Join the files of each station and day, up to a million rows per file.

    Queries during the run may return some rows twice; run it without readers.

    Example: palpate archive compact archive
    """
    from palpate_archive.compacting import join_files
    from palpate_archive.layout import KINDS, Archive

    opened = Archive(archive)
    for kind in KINDS:
        before, after = join_files(opened, kind)
        print(f"{archive}: {kind}: {before} -> {after} files", file=sys.stderr)


def settle(
    archive: ArchiveArgument,
    method: Annotated[
        str,
        typer.Option(
            help="recorded, exponential, log_law, log_law_early or relaxation.",
            metavar="NAME",
            autocompletion=option.complete_methods,
        ),
    ] = "relaxation",
    horizon: HorizonOption = 20.0,
    to: ToOption = None,
    quiet: QuietOption = False,
) -> None:
    """Predict every hold's settled value from 1, 2.5 and 5 s.

    Example: palpate archive settle archive --method exponential
    """
    from palpate.settling.predict import find_method
    from palpate_archive.evaluating import CUTOFFS_S, create_settle_job

    find_method(method)
    if not max(CUTOFFS_S) <= horizon < float("inf"):
        raise InputError(f"--horizon {horizon:g}: give at least {max(CUTOFFS_S):g} s, such as 20")
    _work_on(archive, create_settle_job(method=method, horizon_s=horizon), to=to, quiet=quiet)


def recalibrate(
    archive: ArchiveArgument,
    calibration: Annotated[
        Path, typer.Option(help="The sensor's calibration file.", metavar="FILE")
    ],
    to: ToOption = None,
    quiet: QuietOption = False,
) -> None:
    """Estimate the force of every frame with one calibration; skip other layouts.

    Example: palpate archive recalibrate archive --calibration calibration.json
    """
    from palpate.calibrate.laws import sheet_law_of
    from palpate.sensor.calibration import Calibration
    from palpate_archive.evaluating import create_recalibrate_job

    # Refuse an invalid calibration here instead of in every worker.
    sheet_law_of(Calibration.load(calibration))
    _work_on(archive, create_recalibrate_job(calibration.read_text()), to=to, quiet=quiet)


def _work_on(archive: Path, job: Job, *, to: Path | None, quiet: bool) -> None:
    """Run a job on the archive and print the folder of results."""
    from palpate_archive.evaluating import delete_stale_results, perform, plan_tasks
    from palpate_archive.layout import Archive

    results = to or archive / "results"
    tasks = plan_tasks(job, Archive(archive), to=results)
    if not tasks:
        raise InputError(f"{archive}: contains no {job.reads}; add some with `palpate archive add`")
    left = [task for task in tasks if not task.is_done]
    with progress(job.name, total=len(left), quiet=quiet) as show:
        rows = perform(left, show=show) if left else 0
    delete_stale_results(results / job.name, tasks)
    there = len(tasks) - len(left)
    others = f"; {there} already existed" if there else ""
    print(
        f"{results / job.name}: {len(left)} of {len(tasks)} files written, {rows} rows{others}",
        file=sys.stderr,
    )
