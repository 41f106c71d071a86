"""What each command of `palpate archive` does, and its options."""

from __future__ import annotations

import re
import sys
from collections import Counter
from dataclasses import asdict
from datetime import UTC, datetime, timedelta
from itertools import groupby
from typing import Annotated, TypeAlias

import typer

from palpate.calibration import Calibration
from palpate.cli.options import HorizonOption, JsonOption, QuietOption, complete_methods, opt
from palpate.cli.output import print_json, print_message, progress
from palpate.errors import InputError
from palpate.force.of_calibration import sheet_law_of
from palpate.settling.predict import find_method
from palpate.terminal_table import print_table
from palpate_archive.adding import add_recordings, add_store, find_recordings
from palpate_archive.catalogue import GRACE_S, Catalogue
from palpate_archive.compacting import join_files
from palpate_archive.comparing import compare_results, read_versions
from palpate_archive.evaluating import enter_results, list_versions, plan_tasks
from palpate_archive.folders import Folder, explain_store_errors
from palpate_archive.forgetting import Selection
from palpate_archive.forgetting import forget as forget_rows
from palpate_archive.jobs import CUTOFFS_S, Job, create_recalibrate_job, create_settle_job
from palpate_archive.layout import KINDS, check_name, open_archive
from palpate_station.store.database import Store

_DAY = re.compile(r"\d{4}-\d\d-\d\d|simulated")
ArchiveArgument: TypeAlias = Annotated[
    str, typer.Argument(help="The archive: a folder or an address.", metavar="ARCHIVE")
]
ToOption: TypeAlias = Annotated[
    str | None,
    opt("--to ADDRESS", "Folder or address of the results. [default: results, in the archive]"),
]
SchedulerOption: TypeAlias = Annotated[
    str | None,
    opt(
        "--scheduler ADDRESS",
        "A running Dask scheduler, such as tcp://10.0.0.1:8786. [default: this computer]",
    ),
]


@explain_store_errors()
def add(
    files: Annotated[
        list[str] | None, typer.Argument(help="Recordings, or folders of them; or addresses.")
    ] = None,
    to: Annotated[
        str, opt("--to ARCHIVE", "The archive, a folder or an address; created if it is missing.")
    ] = "archive",
    station: Annotated[
        str | None,
        opt("--station NAME", "Place of the recordings; default: the rig. Required with --store."),
    ] = None,
    store: Annotated[
        str | None, opt("--store FILE_OR_URL", "Add the grasps of this store too.")
    ] = None,
    max_mbit: Annotated[
        float | None, opt("--max-mbit MBIT", "Largest mean rate of writing, megabits per second.")
    ] = None,
    quiet: QuietOption = False,
) -> None:
    """Add recordings and the grasps of a store; skip those already in the archive.

    Example: palpate archive add recordings --to s3://fleet/archive --station north
    """
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
    archive = open_archive(to, create=True, max_mbit=max_mbit)
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
        opt("--grace SECONDS", "Joined files stay so long for queries; a later call deletes them."),
    ] = GRACE_S,
) -> None:
    """Join the files of each station and day, up to a million rows per file.

    Example: palpate archive compact archive
    """
    opened = open_archive(archive)
    for kind in KINDS:
        before, after = join_files(opened, kind, grace_s=grace)
        print(f"{archive}: {kind}: {before} -> {after} files", file=sys.stderr)


@explain_store_errors()
def settle(
    archive: ArchiveArgument,
    method: Annotated[
        str,
        opt(
            "--method NAME",
            "recorded, exponential, log_law, log_law_early or relaxation.",
            autocompletion=complete_methods,
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
    find_method(method)
    if not max(CUTOFFS_S) <= horizon < float("inf"):
        raise InputError(f"--horizon {horizon:g}: give at least {max(CUTOFFS_S):g} s, such as 20")
    job = create_settle_job(method=method, horizon_s=horizon)
    _work_on(archive, job, to=to, scheduler=scheduler, quiet=quiet)


@explain_store_errors()
def recalibrate(
    archive: ArchiveArgument,
    calibration: Annotated[str, opt("--calibration FILE", "The sensor's calibration file.")],
    to: ToOption = None,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Estimate the force of every frame with one calibration; skip other layouts.

    Example: palpate archive recalibrate archive --calibration calibration.json
    """
    folder, name = Folder.divide(calibration)
    with folder.fetch(name) as path:
        # Refuse an invalid calibration here instead of in every worker.
        sheet_law_of(Calibration.load(path))
        job = create_recalibrate_job(path.read_text())
    _work_on(archive, job, to=to, scheduler=scheduler, quiet=quiet)


def _work_on(archive: str, job: Job, *, to: str | None, scheduler: str | None, quiet: bool) -> None:
    """Run a job on the archive and print the folder of results."""
    # Dask is slow to import.
    from palpate_archive.engine import perform

    results = Folder.open(to or f"{archive.rstrip('/')}/results")
    opened = open_archive(archive)
    tasks = plan_tasks(job, opened, to=results)
    if not tasks:
        raise InputError(f"{archive}: contains no {job.reads}; add some with `palpate archive add`")
    catalogue = Catalogue(results, job.name)
    targets = {task.target for task in tasks}
    done = [entry for entry in catalogue.files() if entry.file in targets]
    left = [task for task in tasks if task.target not in {entry.file for entry in done}]
    with progress(job.name, total=len(left), quiet=quiet) as show:
        report = (lambda _: None) if quiet else print_message
        fresh = perform(left, show=show, scheduler=scheduler, report=report)
    enter_results(catalogue, [*done, *fresh], of=Catalogue(opened, job.reads))
    others = f"; {len(done)} already existed" if done else ""
    print(
        f"{results.name(job.name)}: {len(left)} of {len(tasks)} files written, "
        f"{sum(entry.rows for entry in fresh)} rows{others}",
        file=sys.stderr,
    )


@explain_store_errors()
def compare(
    a: Annotated[str, typer.Argument(help="Results: a folder or an address.", metavar="A")],
    b: Annotated[str, typer.Argument(help="Results of another version.", metavar="B")],
    json: JsonOption = False,
) -> None:
    """Compare results of two versions of the code: what changed, by station and day.

    Example: palpate archive compare results-0.1 results-0.2
    """
    one, two = Folder.open(a), Folder.open(b)
    changes = list(compare_results(one, two))
    versions = {name: read_versions(folder) for name, folder in (("a", one), ("b", two))}
    if json:
        print_json({"code": versions, "days": [asdict(change) for change in changes]})
        return
    for name, address in (("a", a), ("b", b)):
        print(f"{name.upper()} = {address}: {'; '.join(map(list_versions, versions[name]))}")
    columns = ["station", "day", ">rows", ">only A", ">only B", ">changed", ">outside"]
    columns += [">median %", ">largest %"]
    for job, days in groupby(changes, key=lambda change: change.job):
        print(f"\n{job}")
        print_table(columns, [tuple(map(_format, asdict(day).values()))[1:] for day in days])


def _format(value: object) -> str:
    return "-" if value is None else f"{value:.2g}" if isinstance(value, float) else str(value)


@explain_store_errors()
def forget(
    archive: ArchiveArgument,
    station: Annotated[str | None, opt("--station NAME", "Rows of this station.")] = None,
    item: Annotated[
        str | None, opt("--item ID", "Grasps of this item, and the recordings that they name.")
    ] = None,
    day: Annotated[str | None, opt("--day YYYY-MM-DD", "Rows of this day, in UTC.")] = None,
    keep_days: Annotated[
        int | None, opt("--keep-days DAYS", "Rows of all days but the last ones.")
    ] = None,
    results: Annotated[
        list[str] | None,
        opt("--results ADDRESS", "Results outside the archive; may be repeated."),
    ] = None,
) -> None:
    """Delete the rows that all given options select, from all files and results, at once.

    Example: palpate archive forget archive --station north --keep-days 365
    """
    if all(each is None for each in (station, item, day, keep_days)):
        raise InputError("nothing selected: give --station, --item, --day or --keep-days")
    if day is not None and not _DAY.fullmatch(day):
        raise InputError(f"--day {day}: give a day as YYYY-MM-DD, or `simulated`")
    before = None
    if keep_days is not None:
        if keep_days < 0:
            raise InputError(f"--keep-days {keep_days}: give at least 0")
        before = f"{datetime.now(UTC) - timedelta(days=keep_days):%Y-%m-%d}"
    opened = open_archive(archive)
    folders = [Folder.open(each) for each in (opened.name("results"), *(results or []))]
    selection = Selection(station=station, item=item, day=day, before=before)
    for kind, rows in forget_rows(opened, selection, results=folders).items():
        print(f"{archive}: {kind}: {rows} rows deleted", file=sys.stderr)
