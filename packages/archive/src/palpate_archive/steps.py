"""The commands of `palpate archive`, registered through an entry point."""

from __future__ import annotations

import re
import sys
from collections import Counter
from itertools import groupby
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from palpate.cli import options as option
from palpate.cli.options import HorizonOption, JsonOption, QuietOption
from palpate.cli.output import print_message, progress
from palpate.errors import InputError
from palpate_archive.folders import explain_store_errors

if TYPE_CHECKING:
    from palpate_archive.jobs import Job

#: Command -> (location, description).
STEPS = {
    "add": (f"{__name__}:add", "Add recordings and the grasps of a store"),
    "compact": (f"{__name__}:compact", "Join the small files of each day"),
    "settle": (f"{__name__}:settle", "Predict the settled value of every hold"),
    "recalibrate": (f"{__name__}:recalibrate", "Estimate the force of every frame"),
    "compare": (f"{__name__}:compare", "Compare the results of two versions"),
    "forget": (f"{__name__}:forget", "Delete stations, items or days"),
}
_DAY = re.compile(r"\d{4}-\d\d-\d\d|simulated")
ArchiveArgument: TypeAlias = Annotated[
    str, typer.Argument(help="The archive: a folder or an address.", metavar="ARCHIVE")
]
ToOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--to",
        help="Folder or address of the results. [default: results, in the archive]",
        metavar="ADDRESS",
    ),
]
SchedulerOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        help="A running Dask scheduler, such as tcp://10.0.0.1:8786. [default: this computer]",
        metavar="ADDRESS",
    ),
]


@explain_store_errors()
def add(
    files: Annotated[
        list[str] | None, typer.Argument(help="Recordings, or folders of them; or addresses.")
    ] = None,
    to: Annotated[
        str,
        typer.Option(
            help="The archive, a folder or an address; created if it does not exist.",
            metavar="ARCHIVE",
        ),
    ] = "archive",
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
    max_mbit: Annotated[
        float | None,
        typer.Option(help="Largest mean rate of writing, megabits per second.", metavar="MBIT"),
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Add recordings and the grasps of a store; skip those already in the archive.

    Example: palpate archive add recordings --to s3://fleet/archive --station north
    """
    from palpate_archive.adding import add_recordings, add_store, find_recordings
    from palpate_archive.layout import Archive, check_name
    from palpate_station.store.database import Store

    recordings = list(find_recordings(files or []))
    if not recordings and store is None:
        if files:
            raise InputError(f"no recordings (.mcap) in {', '.join(files)}")
        raise InputError("nothing to add: name recordings, a folder with recordings, or --store")
    if store is not None and station is None:
        raise InputError("--store: the station of its grasps is unknown; give --station")
    if station is not None:
        check_name("--station", station)
    if max_mbit is not None and not 0 < max_mbit < float("inf"):
        raise InputError(f"--max-mbit {max_mbit:g}: give more than 0, such as 2")
    archive = Archive(to, create=True, max_mbit=max_mbit)
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


@explain_store_errors()
def compact(
    archive: ArchiveArgument,
    grace: Annotated[
        float,
        typer.Option(
            help="How long joined files stay for running queries; a later call deletes them.",
            metavar="SECONDS",
        ),
    ] = 3600.0,
) -> None:
    """Join the files of each station and day, up to a million rows per file.

    Example: palpate archive compact archive
    """
    from palpate_archive.compacting import join_files
    from palpate_archive.layout import KINDS, Archive

    opened = Archive(archive)
    for kind in KINDS:
        before, after = join_files(opened, kind, grace_s=grace)
        print(f"{archive}: {kind}: {before} -> {after} files", file=sys.stderr)


@explain_store_errors()
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
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Predict every hold's settled value from 1, 2.5 and 5 s.

    Example: palpate archive settle archive --method exponential
    """
    from palpate.settling.predict import find_method
    from palpate_archive.jobs import CUTOFFS_S, create_settle_job

    find_method(method)
    if not max(CUTOFFS_S) <= horizon < float("inf"):
        raise InputError(f"--horizon {horizon:g}: give at least {max(CUTOFFS_S):g} s, such as 20")
    job = create_settle_job(method=method, horizon_s=horizon)
    _work_on(archive, job, to=to, scheduler=scheduler, quiet=quiet)


@explain_store_errors()
def recalibrate(
    archive: ArchiveArgument,
    calibration: Annotated[
        str, typer.Option(help="The sensor's calibration file.", metavar="FILE")
    ],
    to: ToOption = None,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Estimate the force of every frame with one calibration; skip other layouts.

    Example: palpate archive recalibrate archive --calibration calibration.json
    """
    from palpate.calibration import Calibration
    from palpate.force.of_calibration import sheet_law_of
    from palpate_archive.folders import Folder
    from palpate_archive.jobs import create_recalibrate_job

    folder, _, name = calibration.rpartition("/")
    with Folder.open(folder or ".").fetch(name) as path:
        # Refuse an invalid calibration here instead of in every worker.
        sheet_law_of(Calibration.load(path))
        job = create_recalibrate_job(path.read_text())
    _work_on(archive, job, to=to, scheduler=scheduler, quiet=quiet)


@explain_store_errors()
def compare(
    a: Annotated[str, typer.Argument(help="Results: a folder or an address.", metavar="A")],
    b: Annotated[str, typer.Argument(help="Results of another version.", metavar="B")],
    json: JsonOption = False,
) -> None:
    """Compare results of two versions of the code: what changed, by station and day.

    Example: palpate archive compare results-0.1 results-0.2
    """
    from dataclasses import asdict

    from palpate.cli.output import print_json
    from palpate.terminal_table import print_table
    from palpate_archive.comparing import compare_results, read_versions
    from palpate_archive.folders import Folder

    one, two = Folder.open(a), Folder.open(b)
    changes = list(compare_results(one, two))
    versions = {name: read_versions(folder) for name, folder in (("a", one), ("b", two))}
    if json:
        print_json({"code": versions, "days": [asdict(change) for change in changes]})
        return
    for name, address in (("a", a), ("b", b)):
        codes = [", ".join(f"{n} {v}" for n, v in code.items()) for code in versions[name]]
        print(f"{name.upper()} = {address}: {'; '.join(codes)}")
    columns = ["station", "day", ">rows", ">only A", ">only B", ">changed", ">outside"]
    columns += [">median %", ">largest %"]
    for job, days in groupby(changes, key=lambda change: change.job):
        print(f"\n{job}")
        print_table(columns, [tuple(map(_format, asdict(day).values()))[1:] for day in days])


@explain_store_errors()
def forget(
    archive: ArchiveArgument,
    station: Annotated[str | None, typer.Option(help="Rows of this station.")] = None,
    item: Annotated[
        str | None, typer.Option(help="Grasps of this item, and the recordings that they name.")
    ] = None,
    day: Annotated[
        str | None, typer.Option(help="Rows of this day, in UTC.", metavar="YYYY-MM-DD")
    ] = None,
    keep_days: Annotated[
        int | None,
        typer.Option(help="Rows of all days but the last ones.", metavar="DAYS"),
    ] = None,
    results: Annotated[
        list[str] | None,
        typer.Option(help="Results outside the archive; may be repeated.", metavar="ADDRESS"),
    ] = None,
) -> None:
    """Delete the rows that all given options select, from all files and results, at once.

    Example: palpate archive forget archive --station north --keep-days 365
    """
    from datetime import UTC, datetime, timedelta

    from palpate_archive.folders import Folder
    from palpate_archive.forgetting import Selection
    from palpate_archive.forgetting import forget as forget_rows
    from palpate_archive.layout import Archive

    if all(each is None for each in (station, item, day, keep_days)):
        raise InputError("nothing selected: give --station, --item, --day or --keep-days")
    if day is not None and not _DAY.fullmatch(day):
        raise InputError(f"--day {day}: give a day as YYYY-MM-DD, or `simulated`")
    before = None
    if keep_days is not None:
        if keep_days < 0:
            raise InputError(f"--keep-days {keep_days}: give at least 0")
        before = f"{datetime.now(UTC) - timedelta(days=keep_days):%Y-%m-%d}"
    opened = Archive(archive)
    folders = [Folder.open(each) for each in (opened.folder.name("results"), *(results or []))]
    selection = Selection(station=station, item=item, day=day, before=before)
    for kind, rows in forget_rows(opened, selection, results=folders).items():
        print(f"{archive}: {kind}: {rows} rows deleted", file=sys.stderr)


def _format(value: object) -> str:
    return "-" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)


def _work_on(archive: str, job: Job, *, to: str | None, scheduler: str | None, quiet: bool) -> None:
    """Run a job on the archive and print the folder of results."""
    from palpate_archive.adding import GRACE_S
    from palpate_archive.catalogue import Catalogue
    from palpate_archive.engine import perform
    from palpate_archive.evaluating import enter_results, find_done, plan_tasks
    from palpate_archive.folders import Folder
    from palpate_archive.layout import Archive

    results = Folder.open(to or f"{archive.rstrip('/')}/results")
    opened = Archive(archive)
    tasks = plan_tasks(job, opened, to=results)
    if not tasks:
        raise InputError(f"{archive}: contains no {job.reads}; add some with `palpate archive add`")
    catalogue = Catalogue(results, job.name)
    done = find_done(catalogue, tasks)
    held = {entry.file for entry in done}
    left = [task for task in tasks if task.target not in held]
    fresh = []
    if left:
        with progress(job.name, total=len(left), quiet=quiet) as show:
            report = (lambda _: None) if quiet else print_message
            fresh = perform(left, show=show, scheduler=scheduler, report=report)
    inputs = opened.catalogue(job.reads)
    enter_results(catalogue, [*done, *fresh], of=inputs, grace_s=GRACE_S)
    others = f"; {len(done)} already existed" if done else ""
    print(
        f"{results.name(job.name)}: {len(left)} of {len(tasks)} files written, "
        f"{sum(entry.rows for entry in fresh)} rows{others}",
        file=sys.stderr,
    )
