"""`palpate archive WHAT`: many stations' grasps, holds and frames as Parquet, and work on them."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.commands import completion
from palpate.commands.steps import SETTINGS, Steps, run_step

__all__ = ["SETTINGS", "STEPS", "archive"]

STEPS: Steps = {
    "add": ("archive_add:add", "Put recordings and a store into it; what is there stays"),
    "compact": ("archive_add:compact", "Join a day's small files into few"),
    "settle": ("archive_work:settle", "Predict the settled value of every hold again"),
    "recalibrate": ("archive_work:recalibrate", "Read the force of every frame again"),
    "judge": ("archive_work:judge", "Decide again which bin each grasp alone would have chosen"),
}


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
        STEPS,
        what="step",
        example="palpate archive add recordings --to archive",
    )
