"""`palpate archive settle`, `recalibrate` and `judge`: estimate all of an archive again."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import typer

from palpate.cli import completion
from palpate.cli.options import HorizonOption, QuietOption
from palpate.cli.progress import progress
from palpate.errors import InputError

if TYPE_CHECKING:
    from palpate_archive.jobs import Job


Engine: TypeAlias = Literal["local", "dask"]
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


def settle(
    archive: ArchiveArgument,
    method: Annotated[
        str,
        typer.Option(
            help="recorded, exponential, log_law, log_law_early or relaxation.",
            metavar="NAME",
            autocompletion=completion.methods,
        ),
    ] = "relaxation",
    horizon: HorizonOption = 20.0,
    to: ToOption = None,
    engine: EngineOption = "local",
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Predict every hold's settled value from 1, 2.5 and 5 s, next to the value it reached.

    Example: palpate archive settle archive --method exponential
    """
    from palpate.settling.predict import method_named
    from palpate_archive.jobs import Settle

    method_named(method)
    job = Settle(method=method, horizon_s=horizon)
    if not max(job.cutoffs_s) <= horizon < float("inf"):
        raise InputError(
            f"--horizon {horizon:g}: give seconds from {max(job.cutoffs_s):g} on, such as 20"
        )
    _work_on(archive, job, to=to, engine=engine, scheduler=scheduler, quiet=quiet)


def recalibrate(
    archive: ArchiveArgument,
    calibration: Annotated[
        Path, typer.Option(help="The sensor's calibration file.", metavar="FILE")
    ],
    to: ToOption = None,
    engine: EngineOption = "local",
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Read the force of every frame again by one calibration; other sensors' frames stay empty.

    Example: palpate archive recalibrate archive --calibration calibration.json
    """
    from palpate.grasp.planning import laws_of
    from palpate.sensor.calibration import Calibration
    from palpate_archive.jobs import Recalibrate

    # Refused here, and not by every worker.
    laws_of(Calibration.load(calibration).force)
    job = Recalibrate(calibration=calibration.read_text())
    _work_on(archive, job, to=to, engine=engine, scheduler=scheduler, quiet=quiet)


def judge(
    archive: ArchiveArgument,
    rules: Annotated[Path, typer.Option(help="The rules, a TOML file.", metavar="FILE")],
    to: ToOption = None,
    engine: EngineOption = "local",
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Decide which bin each grasp alone would have sent its item to, by its kind and its size.

    Ripeness and bruises take an item's history, which only a store has: `palpate sort`.

    Example: palpate archive judge archive --rules rules.toml
    """
    from palpate.produce.sorting.rules_file import read_rules
    from palpate_archive.jobs import Judge

    read_rules(rules)
    job = Judge(rules=rules.resolve(), text=rules.read_text())
    _work_on(archive, job, to=to, engine=engine, scheduler=scheduler, quiet=quiet)


def _work_on(
    archive: Path,
    job: Job,
    *,
    to: Path | None,
    engine: Engine,
    scheduler: str | None,
    quiet: bool,
) -> None:
    """Run a job over the archive and print where the results are."""
    from palpate_archive.layout import Archive
    from palpate_archive.running import forget_others, run_here, run_on_dask, tasks_of

    if scheduler is not None and engine != "dask":
        raise InputError(f"--scheduler {scheduler}: goes with --engine dask")
    results = to or archive / "results"
    tasks = tasks_of(job, Archive(archive), to=results)
    if not tasks:
        raise InputError(f"{archive}: holds no {job.reads}; add some with `palpate archive add`")
    left = [task for task in tasks if not task.done]
    with progress(job.name, total=len(left), quiet=quiet) as show:
        if not left:
            rows = 0
        elif engine == "dask":
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
