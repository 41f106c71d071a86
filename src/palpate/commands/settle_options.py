"""The options of `palpate settle`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

from palpate.commands import completion

#: Place of the sensor in its divider.
Leg: TypeAlias = Literal["upper", "lower"]

HoldsArgument: TypeAlias = Annotated[
    list[Path],
    typer.Argument(
        help="Recordings: CSV, TSV, Excel, Parquet, gzipped or not, or folders of them. A table "
        "with hold_id,time_s,value is a file of holds; others are cut into holds.",
        metavar="FILE_OR_FOLDER",
    ),
]
MethodOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help="recorded, exponential, log_law, log_law_early or relaxation; may be repeated. "
        "[default: relaxation]",
        metavar="NAME",
        autocompletion=completion.methods,
    ),
]
CutoffOption: TypeAlias = Annotated[
    list[float] | None,
    typer.Option(help="Use samples up to here; may be repeated. [default: 2.5]", metavar="SECONDS"),
]
HorizonOption: TypeAlias = Annotated[
    float, typer.Option(help="Time of the settled value.", metavar="SECONDS")
]
LevelOption: TypeAlias = Annotated[
    float, typer.Option(help="Probability the interval is to cover.")
]
FitOnOption: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(help="Calibration holds: intervals as wide as errors on these.", metavar="HOLDS"),
]
LearnFromOption: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        help="This sensor's own settled holds, for `relaxation` to learn from.", metavar="HOLDS"
    ),
]
OwnRigOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--rig", help="Learn from the settled holds that this rig file keeps.", metavar="FILE"
    ),
]
UntilOption: TypeAlias = Annotated[
    float | None,
    typer.Option(
        help="Decide for each hold as soon as the half-width of its interval is below this.",
        metavar="PERCENT",
    ),
]
TimeColumnOption: TypeAlias = Annotated[
    str | None,
    typer.Option(help="Column of times. [default: by usual names]", metavar="NAME"),
]
TimeUnitOption: TypeAlias = Annotated[
    Literal["s", "ms", "us", "unix"] | None,
    typer.Option(help="s, ms, us or unix. [default: by name and values]", metavar="UNIT"),
]
ValueColumnOption: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        help="Column of readings; may be repeated. [default: by usual names]", metavar="NAME"
    ),
]
UnitOption: TypeAlias = Annotated[
    Literal["ohm", "percent", "counts", "volt"] | None,
    typer.Option(help="ohm, percent, counts or volt. [default: by their names]", metavar="UNIT"),
]
AdcBitsOption: TypeAlias = Annotated[
    int | None, typer.Option(help="Resolution of the converter: counts become ohm.", metavar="N")
]
ReferenceOhmOption: TypeAlias = Annotated[
    float | None, typer.Option(help="The divider's fixed resistor.", metavar="OHM")
]
LegOption: TypeAlias = Annotated[
    Leg | None,
    typer.Option(
        help="Where the sensor is: upper (at the supply) or lower (at ground).", metavar="LEG"
    ),
]
CutOption: TypeAlias = Annotated[
    str,
    typer.Option(
        help="Where holds begin: auto (after each contact), none (at the first row), or a time.",
        metavar="auto|none|SECONDS",
    ),
]
RestOption: TypeAlias = Annotated[
    str | None,
    typer.Option(
        "--rest",
        help="Stretch without load, seconds: readings become relative changes.",
        metavar="START:END",
    ),
]
MeanOption: TypeAlias = Annotated[
    bool,
    typer.Option("--mean", help="With --rest: predict the mean of all columns, as in the paper."),
]
PlotOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(
        help="Draw where it cut, and typical and worst holds (.png, .svg, .pdf).", metavar="FILE"
    ),
]
OutOption: TypeAlias = Annotated[
    Path | None,
    typer.Option(help="Write all of it (.json) or the rows (.csv, .parquet).", metavar="FILE"),
]
