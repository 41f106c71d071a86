"""`palpate archive settle DIR`."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.archive_work import (
    ArchiveArgument,
    Engine,
    EngineOption,
    SchedulerOption,
    ToOption,
    work_on,
)
from palpate.commands.options import QuietOption
from palpate.commands.settle_options import HorizonOption
from palpate.errors import InputError


def command(
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
    engine: EngineOption = Engine.LOCAL,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Predict every hold's settled value from 1, 2.5 and 5 s, next to the value it reached.

    Example: palpate archive settle archive --method exponential
    """
    from palpate.archive.jobs import Settle
    from palpate.settling.predict import method_named

    method_named(method)
    job = Settle(method=method, horizon_s=horizon)
    if not max(job.cutoffs_s) <= horizon < float("inf"):
        raise InputError(
            f"--horizon {horizon:g}: give seconds from {max(job.cutoffs_s):g} on, such as 20"
        )
    work_on(archive, job, to=to, engine=engine, scheduler=scheduler, quiet=quiet)
