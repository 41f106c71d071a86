"""`palpate archive judge DIR --rules FILE`."""

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
    rules: Annotated[Path, typer.Option(help="The rules, a TOML file.", metavar="FILE")],
    to: ToOption = None,
    engine: EngineOption = Engine.LOCAL,
    scheduler: SchedulerOption = None,
    quiet: QuietOption = False,
) -> None:
    """Decide which bin each grasp alone would have sent its item to, by its kind and its size.

    Ripeness and bruises take an item's history, which only a store has: `palpate sort`.

    Example: palpate archive judge archive --rules rules.toml
    """
    from palpate.archive.jobs import Judge
    from palpate.produce.sorting.rules_file import read_rules

    read_rules(rules)
    job = Judge(rules=rules.resolve(), text=rules.read_text())
    work_on(archive, job, to=to, engine=engine, scheduler=scheduler, quiet=quiet)
