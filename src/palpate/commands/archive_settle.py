"""`palpate archive settle DIR`."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands.archive_work import (
    ArchiveArgument,
    Engine,
    EngineOption,
    SchedulerOption,
    ToOption,
    work_on,
)
from palpate.commands.options import QuietOption


def command(
    archive: ArchiveArgument,
    method: Annotated[str, typer.Option(help="What to predict with.")] = "relaxation",
    horizon_s: Annotated[float, typer.Option(help="Time of the value to predict.")] = 20.0,
    to: ToOption = None,
    engine: EngineOption = Engine.LOCAL,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Predict every hold's settled value from 1, 2.5 and 5 s, beside the value it came to.

    Example: palpate archive settle archive --method exponential
    """
    from palpate.archive.jobs import Settle
    from palpate.settling.predict import method_named

    method_named(method)
    work_on(
        archive,
        Settle(method=method, horizon_s=horizon_s),
        to=to,
        engine=engine,
        scheduler=scheduler,
        quiet=quiet,
    )
