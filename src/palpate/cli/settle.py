"""`palpate settle`: the settled value of recorded holds, predicted from their first seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from math import isnan
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import typer

from palpate.cli import options as option
from palpate.cli import settle_report as report
from palpate.cli.calibrate_settling import place_of_holds
from palpate.cli.options import DpiOption, HorizonOption, JsonOption, QuietOption
from palpate.cli.output import print_json, progress, say
from palpate.cli.settle_source import (
    HoldSource,
    Leg,
    ReadingOptions,
    cut_at,
    divider_of,
    rest_stretch,
)
from palpate.errors import InputError
from palpate.holds import Hold, settled_value
from palpate.plots.style import check_plot
from palpate.scoring.predictions import Prediction, decide_holds, predict_holds
from palpate.scoring.table import ScoreTable
from palpate.settling.calibrated import Calibrated
from palpate.settling.predict import method_named
from palpate.settling.result import SettlingMethod

DEFAULT_CUTOFF_S = 2.5
#: A 90 % interval from residuals alone takes nine of them; twice that to be worth its name.
FEW_CALIBRATION_HOLDS = 20
#: No hold of 20 s is sampled that slowly.
SLOWEST_S = 4.0


def settle(
    holds: Annotated[
        list[Path],
        typer.Argument(
            help="Recordings: CSV, TSV, Excel, Parquet, gzipped or not, or folders of them. A "
            "table with hold_id,time_s,value is a file of holds; others are cut into holds.",
            metavar="FILE_OR_FOLDER",
        ),
    ],
    method: Annotated[
        list[str] | None,
        typer.Option(
            help="recorded, exponential, log_law, log_law_early or relaxation; may be repeated. "
            "[default: relaxation]",
            metavar="NAME",
            autocompletion=option.complete_methods,
        ),
    ] = None,
    cutoff: Annotated[
        list[float] | None,
        typer.Option(
            help="Use samples up to here; may be repeated. [default: 2.5]", metavar="SECONDS"
        ),
    ] = None,
    horizon: HorizonOption = 20.0,
    level: Annotated[
        float, typer.Option(help="Probability the interval is to cover.", metavar="FRACTION")
    ] = 0.9,
    fit_on: Annotated[
        list[Path] | None,
        typer.Option(
            help="Calibration holds: intervals as wide as errors on these.", metavar="HOLDS"
        ),
    ] = None,
    learn_from: Annotated[
        list[Path] | None,
        typer.Option(
            help="This sensor's own settled holds, for `relaxation` to learn from.",
            metavar="HOLDS",
        ),
    ] = None,
    rig: Annotated[
        str | None,
        typer.Option(help="Learn from the settled holds that this rig file keeps.", metavar="FILE"),
    ] = None,
    until_half_width: Annotated[
        float | None,
        typer.Option(
            help="Decide for each hold as soon as the half-width of its interval is below this.",
            metavar="PERCENT",
        ),
    ] = None,
    time_column: Annotated[
        str | None, typer.Option(help="Column of times. [default: by usual names]", metavar="NAME")
    ] = None,
    time_unit: Annotated[
        Literal["s", "ms", "us", "unix"] | None,
        typer.Option(help="s, ms, us or unix. [default: by name and values]", metavar="UNIT"),
    ] = None,
    value_column: Annotated[
        list[str] | None,
        typer.Option(
            help="Column of readings; may be repeated. [default: by usual names]", metavar="NAME"
        ),
    ] = None,
    unit: Annotated[
        Literal["ohm", "percent", "counts", "volt"] | None,
        typer.Option(
            help="ohm, percent, counts or volt. [default: by their names]", metavar="UNIT"
        ),
    ] = None,
    adc_bits: Annotated[
        int | None,
        typer.Option(help="Resolution of the converter: counts become ohm.", metavar="N"),
    ] = None,
    reference_ohm: Annotated[
        float | None, typer.Option(help="The divider's fixed resistor.", metavar="OHM")
    ] = None,
    sensor_leg: Annotated[
        Leg | None,
        typer.Option(
            help="Where the sensor is: upper (at the supply) or lower (at ground).", metavar="LEG"
        ),
    ] = None,
    cut: Annotated[
        str,
        typer.Option(
            help="Where holds begin: auto (after each contact), none (at the first row), or a "
            "time.",
            metavar="auto|none|SECONDS",
        ),
    ] = "auto",
    rest: Annotated[
        str | None,
        typer.Option(
            help="Stretch without load, seconds: readings become relative changes.",
            metavar="START:END",
        ),
    ] = None,
    mean: Annotated[
        bool,
        typer.Option(
            "--mean", help="With --rest: predict the mean of all columns, as in the paper."
        ),
    ] = False,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Draw where it cut, and typical and worst holds (.png, .svg, .pdf).",
            metavar="FILE",
        ),
    ] = None,
    dpi: DpiOption = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Write all of it (.json) or the rows (.csv, .parquet).", metavar="FILE"),
    ] = None,
) -> None:
    """Predict what recordings settle to from their first seconds, with the error.

    Example: palpate settle recording.csv --plot cuts.png
    """
    cutoffs_s = tuple(cutoff or ([] if until_half_width else [DEFAULT_CUTOFF_S]))
    _check_numbers(cutoffs_s, horizon_s=horizon, level=level, until=until_half_width)
    if plot is not None or (cutoffs_s and until_half_width):
        _check_rereadable(holds)
    source = HoldSource(
        paths=holds,
        reading=ReadingOptions(
            time_column=time_column,
            time_unit=time_unit,
            value_columns=tuple(value_column or ()),
            unit=unit,
            divider=divider_of(adc_bits, reference_ohm, sensor_leg, unit=unit),
            cut=cut_at(cut),
            rest_s=rest_stretch(rest, mean=mean, unit=unit),
            mean=mean,
        ),
    )
    files = source.files()
    check_plot(plot, dpi=dpi)
    report.check_outputs(plot=plot, out=out, inputs=[*files, *(fit_on or []), *(learn_from or [])])
    names = method or ["relaxation"]
    if rig is not None:
        learn_from = [*(learn_from or []), _find_own_holds(rig)]
    _check_unseen(learn_from or [], files=files)
    chosen = _methods(
        names,
        fit_on=fit_on or [],
        learn_from=learn_from or [],
        horizon_s=horizon,
        percent=unit == "percent" or rest is not None,
    )
    if until_half_width and not fit_on:
        _warn_without_interval(chosen)
    predictions = list(
        _predict(
            source,
            methods=chosen,
            cutoffs_s=cutoffs_s,
            horizon_s=horizon,
            level=level,
            until_half_width_percent=until_half_width,
            quiet=quiet or as_json,
        )
    )
    if not predictions:
        raise InputError(f"{holds[0]}: no hold in any of its files")
    document = ScoreTable(
        predictions=predictions,
        horizon_s=horizon,
        level=level,
        until_half_width_percent=until_half_width,
    )
    if out is not None:
        report.write(document, out)
    if plot is not None:
        report.draw(document, source, plot, dpi=dpi, methods=chosen, level=level)
    if as_json:
        print_json(document.to_dict())
    else:
        report.print_tables(document, level=level, written=[p for p in (out, plot) if p])


def _check_numbers(
    cutoffs_s: Sequence[float], *, horizon_s: float, level: float, until: float | None
) -> None:
    if not 0 < horizon_s < float("inf"):
        raise InputError(f"--horizon {horizon_s:g}: give a positive time in seconds, such as 20")
    for cutoff_s in cutoffs_s:
        if not 0 < cutoff_s <= horizon_s:
            raise InputError(
                f"--cutoff {cutoff_s:g}: give a time above 0 s and not after the horizon "
                f"({horizon_s:g} s)"
            )
    if not 0 < level < 1:
        raise InputError(f"--level {level:g}: give a probability between 0 and 1, such as 0.9")
    if until is not None and not 0 < until < float("inf"):
        raise InputError(f"--until-half-width {until:g}: give a positive percentage, such as 2.5")


def _warn_without_interval(methods: Iterable[str]) -> None:
    without = [name for name in methods if name != "relaxation"]
    if without:
        say(
            f"palpate: --until-half-width: {', '.join(without)} has no interval without --fit-on, "
            "so it waits to the end of each hold"
        )


def _check_rereadable(files: Sequence[Path]) -> None:
    for file in files:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise InputError(
                f"{file}: a pipe can be read only once, and --plot (or --cutoff together with "
                "--until-half-width) reads twice; save it as a file first"
            )


def _warn_of_milliseconds(holds: Iterator[Hold], *, source: str) -> Iterator[Hold]:
    """Pass holds on; warn once if their times seem to be in another unit."""
    warned = False
    for hold in holds:
        if not warned and len(hold.time_s) > 1:
            step_s = float(np.median(np.diff(hold.time_s)))
            if warned := step_s > SLOWEST_S:
                say(
                    f"palpate: {source}: hold {hold.hold_id} has a sample every {step_s:g} s; "
                    "time_s is in seconds, are these milliseconds?"
                )
        yield hold


def _find_own_holds(rig: str) -> Path:
    place = place_of_holds(rig)
    if not place.exists():
        raise InputError(
            f"--rig {rig}: it keeps no settled holds yet; `palpate calibrate settling RECORDINGS "
            f"--rig {rig}` cuts them from recordings"
        )
    return place


def _check_unseen(learn_from: Sequence[Path], *, files: Sequence[Path]) -> None:
    predicted = {file.resolve() for file in files}
    for file in learn_from:
        if file.resolve() in predicted:
            raise InputError(
                f"--learn-from {file}: its holds are to be predicted too, and scores on holds that "
                "were learned from mean nothing; give the sensor's other holds"
            )


def _methods(
    names: Sequence[str],
    *,
    fit_on: Sequence[Path],
    learn_from: Sequence[Path],
    horizon_s: float,
    percent: bool,
) -> dict[str, SettlingMethod]:
    """Make each method once; the sensor's own holds and calibration holds sharpen some."""
    made = {name: method_named(name) for name in names}
    if learn_from and "relaxation" in made:
        own = _read_settled_holds(
            learn_from, horizon_s=horizon_s, option="--learn-from", percent=percent
        )
        made["relaxation"] = Calibrated(holds=tuple(own))
    if not fit_on:
        return made
    holds = _read_settled_holds(fit_on, horizon_s=horizon_s, option="--fit-on", percent=percent)
    if len(holds) < FEW_CALIBRATION_HOLDS:
        say(
            f"palpate: --fit-on: {len(holds)} holds reach {horizon_s:g} s; intervals from fewer "
            f"than {FEW_CALIBRATION_HOLDS} are rough or missing"
        )
    return {
        name: Calibrated(method=method, holds=holds, learn=False) for name, method in made.items()
    }


def _read_settled_holds(
    files: Sequence[Path], *, horizon_s: float, option: str, percent: bool
) -> list[Hold]:
    """Return the holds that reach the horizon; refuse where `--learn-from` has none."""
    source = HoldSource(paths=files, reading=ReadingOptions(unit="percent" if percent else None))
    holds = [hold for file in source.files() for hold in source.holds(file, until_s=horizon_s)]
    kept = [h for h in holds if not isnan(settled_value(h.time_s, h.values, horizon_s=horizon_s))]
    if option == "--learn-from" and not kept:
        raise InputError(
            f"--learn-from {files[0]}: none of its {len(holds)} holds reaches {horizon_s:g} s, so "
            "none shows what it settles to; hold for longer while recording"
        )
    return kept


def _predict(
    source: HoldSource,
    *,
    methods: Mapping[str, SettlingMethod],
    cutoffs_s: Sequence[float],
    horizon_s: float,
    level: float,
    until_half_width_percent: float | None,
    quiet: bool,
) -> Iterator[Prediction]:
    """Yield predictions file by file while a bar on standard error shows how far it is."""
    files = source.files()
    with progress("settling", total=len(files), quiet=quiet) as show:
        for number, file in enumerate(files):
            if cutoffs_s:
                held = source.holds(file, until_s=horizon_s, progress=_show_fraction(number, show))
                yield from predict_holds(
                    _warn_of_milliseconds(held, source=str(file)),
                    methods=methods,
                    cutoffs_s=cutoffs_s,
                    horizon_s=horizon_s,
                    level=level,
                    source=str(file),
                )
            if until_half_width_percent is not None:
                held = source.holds(file, until_s=horizon_s, progress=_show_fraction(number, show))
                yield from decide_holds(
                    held if cutoffs_s else _warn_of_milliseconds(held, source=str(file)),
                    methods=methods,
                    half_width_percent=until_half_width_percent,
                    horizon_s=horizon_s,
                    level=level,
                    source=str(file),
                )


def _show_fraction(number: int, show: Callable[[float], None]) -> Callable[[float], None]:
    """Return a function that shows which fraction of a file is read."""
    return lambda fraction: show(number + fraction)
