"""`palpate archive STEP`: many stations' grasps, holds and frames as Parquet, and work on them."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.packages import ARCHIVE, needed
from palpate.commands.steps import SETTINGS, run_step

__all__ = ["SETTINGS", "archive"]


def archive(
    context: typer.Context,
    step: Annotated[
        str | None, typer.Argument(help="What to do.", autocompletion=completion.archive_steps)
    ] = None,
) -> None:
    """Keep grasps, holds and frames as partitioned Parquet, and estimate all of it again.

    Example: palpate archive add recordings --to archive
    """
    run_step(
        context,
        step,
        needed(ARCHIVE),
        what="step",
        example="palpate archive add recordings --to archive",
    )
