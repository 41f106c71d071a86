"""Shared by the steps that work on a whole archive: its place, the engine, the report."""

from __future__ import annotations

import sys
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from palpate.commands.progress import progress
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate.archive.jobs import Job


class Engine(StrEnum):
    """Where the work is done."""

    LOCAL = "local"
    DASK = "dask"


ArchiveArgument: TypeAlias = Annotated[Path, typer.Argument(help="The archive.", metavar="DIR")]
ToOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        "--to", help="Folder of the results. [default: results, in the archive]", metavar="DIR"
    ),
]
EngineOption: TypeAlias = Annotated[
    Engine, typer.Option("--engine", help="All cores of this machine, or a Dask cluster.")
]
SchedulerOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--scheduler",
        help="With --engine dask: its address; its workers must see the same folders. Without it, "
        "workers are started here.",
        metavar="ADDRESS",
    ),
]


def work_on(
    archive: Path,
    job: Job,
    *,
    to: Path | None,
    engine: Engine,
    scheduler: str | None,
    quiet: bool,
) -> None:
    """Run a job over the archive and print where the results are."""
    from palpate.archive.layout import Archive
    from palpate.archive.running import forget_others, run_here, run_on_dask, tasks_of

    if scheduler is not None and engine is not Engine.DASK:
        raise InputError(f"--scheduler {scheduler}: goes with --engine dask")
    results = to or archive / "results"
    tasks = tasks_of(job, Archive(archive), to=results)
    if not tasks:
        raise InputError(f"{archive}: holds no {job.reads}; add some with `palpate archive add`")
    left = [task for task in tasks if not task.done]
    with progress(job.name, total=len(left), quiet=quiet) as show:
        if not left:
            rows = 0
        elif engine is Engine.DASK:
            rows = run_on_dask(left, scheduler=scheduler, show=show)
        else:
            rows = run_here(left, show=show)
    forget_others(results / job.name, tasks)
    there = len(tasks) - len(left)
    others = f"; {there} were there already" if there else ""
    print(
        f"{results / job.name}: {len(left)} of {len(tasks)} files written, {rows} rows{others}",
        file=sys.stderr,
    )
