"""`palpate bench NAME`: how fast it is on this machine."""

from __future__ import annotations

from typing import Annotated

import typer

from palpate.errors import InputError
from palpate.studies.report import JsonOption, OutOption

BENCHMARKS = ("settling",)


def bench(
    name: Annotated[str, typer.Argument(help=f"Which: {', '.join(BENCHMARKS)}.")],
    quick: Annotated[
        bool, typer.Option("--quick", help="Smaller batches and fewer repeats: some seconds.")
    ] = False,
    as_json: JsonOption = False,
    out: OutOption = None,
) -> None:
    """Measure speed, memory and agreement with other libraries.

    Example: palpate bench settling --quick
    """
    if name not in BENCHMARKS:
        raise InputError(f"no benchmark {name!r}; there are: {', '.join(BENCHMARKS)}")
    from palpate.studies.settling_speed import FULL, QUICK, measure

    measure(QUICK if quick else FULL).emit(as_json=as_json, out=out)
