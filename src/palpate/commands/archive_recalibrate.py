"""`palpate archive recalibrate DIR --calibration FILE`."""

from __future__ import annotations

from pathlib import Path
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
    calibration: Annotated[
        Path, typer.Option(help="The sensor's calibration file.", metavar="FILE")
    ],
    to: ToOption = None,
    engine: EngineOption = Engine.LOCAL,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Read the force of every frame again by one calibration; other sensors' frames stay empty.

    Example: palpate archive recalibrate archive --calibration calibration.json
    """
    from palpate.archive.jobs import Recalibrate
    from palpate.grasp.planning import laws_of
    from palpate.sensor.calibration import Calibration

    # Refused here, and not by every worker.
    laws_of(Calibration.load(calibration).force)
    job = Recalibrate(calibration=calibration.read_text())
    work_on(archive, job, to=to, engine=engine, scheduler=scheduler, quiet=quiet)
