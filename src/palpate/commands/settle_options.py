"""The options of `palpate settle`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

import typer

HoldsArgument: TypeAlias = Annotated[
    list[Path],
    typer.Argument(help="Holds files: CSV, CSV.gz or Parquet with hold_id,time_s,value."),
]
MethodOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(help="Method; may be repeated. [default: relaxation]", metavar="NAME"),
]
CutoffOption: TypeAlias = Annotated[
    list[float] | None,
    typer.Option(help="Use samples up to here, s; may be repeated. [default: 2.5]"),
]
HorizonOption: TypeAlias = Annotated[float, typer.Option(help="Time of the settled value, s.")]
LevelOption: TypeAlias = Annotated[
    float, typer.Option(help="Probability the interval is to cover.")
]
FitOnOption: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(help="Calibration holds: intervals as wide as errors on these.", metavar="HOLDS"),
]
UntilOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        help="Decide for each hold as soon as the half-width of its interval is below this.",
        metavar="PERCENT",
    ),
]
PlotOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Draw typical and worst holds (.png, .svg, .pdf).", metavar="FILE"),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Write all of it (.json) or the rows (.csv, .parquet).", metavar="FILE"),
]
