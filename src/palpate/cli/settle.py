"""`palpate settle`: predict settled values of recorded holds from their first seconds."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

from palpate.cli import options as option
from palpate.cli import settle_report as report
from palpate.cli.calibrate_settling import get_holds_path
from palpate.cli.options import HorizonOption, JsonOption, QuietOption, opt
from palpate.cli.output import check_table_file, print_json, print_message, progress, write_table
from palpate.cli.settle_source import (
    HoldSource,
    ReadingOptions,
    make_divider,
    parse_cut,
    parse_rest,
)
from palpate.errors import InputError
from palpate.holds import Hold, measure_settled_value
from palpate.plots.style import check_plot
from palpate.scoring.predictions import Prediction, decide_holds, predict_holds
from palpate.scoring.table import ScoreTable
from palpate.settling.calibrated import MIN_PROOF_HOLDS, Calibrated
from palpate.settling.predict import find_method
from palpate.settling.result import SettlingMethod

DEFAULT_CUTOFF_S = 2.5
#: Warn below this number of holds; a 90 % interval requires at least nine residuals.
FEW_CALIBRATION_HOLDS = 20


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
        opt(
            "--method NAME",
            "recorded, exponential, log_law, log_law_early or relaxation; may be repeated. "
            "[default: relaxation]",
            autocompletion=option.complete_methods,
        ),
    ] = None,
    cutoff: Annotated[
        list[float] | None,
        opt("--cutoff SECONDS", "Use samples up to this time; may be repeated. [default: 2.5]"),
    ] = None,
    horizon: HorizonOption = 20.0,
    level: Annotated[
        float, opt("--level FRACTION", "Coverage probability of the intervals.")
    ] = 0.9,
    fit_on: Annotated[
        list[Path] | None,
        opt("--fit-on HOLDS", "Calibration holds, whose errors set the width of the intervals."),
    ] = None,
    learn_from: Annotated[
        list[Path] | None,
        opt(
            "--learn-from HOLDS", "Settled holds of this sensor, as training data of `relaxation`."
        ),
    ] = None,
    rig: Annotated[
        str | None, opt("--rig FILE", "Learn from the settled holds stored for this rig file.")
    ] = None,
    until_half_width: Annotated[
        float | None,
        opt(
            "--until-half-width PERCENT",
            "Predict each hold as soon as the half-width of its interval is below this.",
        ),
    ] = None,
    time_column: option.TimeColumnOption = None,
    time_unit: option.TimeUnitOption = None,
    interval: option.IntervalOption = None,
    sheet: option.SheetOption = None,
    decimal: option.DecimalOption = None,
    value_column: Annotated[
        list[str] | None,
        opt(
            "--value-column NAME",
            "Column of readings; may be repeated. [default: from common names]",
        ),
    ] = None,
    unit: option.UnitOption = None,
    adc_bits: Annotated[
        int | None, opt("--adc-bits N", "Resolution of the converter, to convert counts to ohms.")
    ] = None,
    reference_ohm: option.ReferenceOhmOption = None,
    sensor_leg: option.SensorLegOption = None,
    cut: Annotated[
        str,
        opt(
            "--cut auto|none|SECONDS",
            "Start of holds: auto (after each contact), none (at the first row), or a time.",
        ),
    ] = "auto",
    rest: Annotated[
        str | None,
        opt(
            "--rest START:END",
            "Interval without load, seconds, to convert readings to relative changes.",
        ),
    ] = None,
    mean: Annotated[
        bool, opt("--mean", "With --rest: predict the mean of all columns, as in the paper.")
    ] = False,
    plot: Annotated[
        Path | None,
        opt("--plot FILE", "Plot the cuts and typical and worst holds: .png, .svg or .pdf."),
    ] = None,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
    out: Annotated[
        Path | None,
        opt("--out FILE", "Write the JSON document (.json) or its rows (.csv, .parquet)."),
    ] = None,
) -> None:
    """Predict the settled values of recordings from their first seconds.

    Holds that last until the horizon also report the prediction error.

    Example: palpate settle recording.csv --plot cuts.png
    """
    cutoffs_s = tuple(cutoff or ([] if until_half_width else [DEFAULT_CUTOFF_S]))
    _check_numbers(
        cutoffs_s, horizon_s=horizon, level=level, until=until_half_width, interval_s=interval
    )
    if plot is not None or (cutoffs_s and until_half_width):
        _refuse_pipes(holds)
    source = HoldSource(
        paths=holds,
        reading=ReadingOptions(
            time_column=time_column,
            time_unit=time_unit,
            interval_s=interval,
            sheet=sheet,
            decimal=decimal,
            value_columns=tuple(value_column or ()),
            unit=unit,
            divider=make_divider(adc_bits, reference_ohm, sensor_leg, unit=unit),
            cut=parse_cut(cut),
            rest_s=parse_rest(rest, mean=mean, unit=unit),
            mean=mean,
        ),
    )
    files = source.files()
    check_plot(plot)
    check_table_file(out, option="--out", inputs=[*files, *(fit_on or []), *(learn_from or [])])
    own = [*(learn_from or []), *([] if rig is None else [_find_own_holds(rig)])]
    _check_held_out(own, files=files)
    chosen = _make_methods(
        method or ["relaxation"],
        fit_on=fit_on or [],
        learn_from=own,
        horizon_s=horizon,
        percent=unit == "percent" or rest is not None,
    )
    others = ", ".join(name for name in chosen if name != "relaxation")
    if until_half_width and not fit_on and others:
        print_message(
            f"palpate: --until-half-width: {others} has no interval without --fit-on, so the "
            "prediction uses each full hold"
        )
    with progress("settling", total=len(files), quiet=quiet or as_json) as show:
        predictions = _predict(
            source,
            methods=chosen,
            cutoffs_s=cutoffs_s,
            half_width_percent=until_half_width,
            horizon_s=horizon,
            level=level,
            show=show,
        )
    if not predictions:
        raise InputError(f"{holds[0]}: the files contain no holds")
    document = ScoreTable(
        predictions=predictions,
        horizon_s=horizon,
        level=level,
        until_half_width_percent=until_half_width,
    )
    if out is not None:
        write_table(out, list(document.rows()), document=document.to_dict())
    if plot is not None:
        report.draw(document, source, plot, methods=chosen)
    if as_json:
        print_json(document.to_dict())
    else:
        report.print_tables(document, written=[p for p in (out, plot) if p])


def _predict(
    source: HoldSource,
    *,
    methods: Mapping[str, SettlingMethod],
    cutoffs_s: Sequence[float],
    half_width_percent: float | None,
    horizon_s: float,
    level: float,
    show: Callable[[float], None],
) -> list[Prediction]:
    """Predict all holds at the cut-offs, and as soon as their intervals are narrow enough.

    `show`: called with the number of read files.
    """
    predictions: list[Prediction] = []
    for number, file in enumerate(source.files()):

        def show_fraction(fraction: float, *, done: int = number) -> None:
            show(done + fraction)

        read = partial(source.holds, file, until_s=horizon_s, progress=show_fraction)
        options: dict[str, Any] = {
            "methods": methods,
            "horizon_s": horizon_s,
            "level": level,
            "source": str(file),
        }
        if cutoffs_s:
            predictions += predict_holds(read(), cutoffs_s=cutoffs_s, **options)
        if half_width_percent is not None:
            predictions += decide_holds(read(), half_width_percent=half_width_percent, **options)
    return predictions


def _check_numbers(
    cutoffs_s: Sequence[float],
    *,
    horizon_s: float,
    level: float,
    until: float | None,
    interval_s: float | None,
) -> None:
    if not 0 < horizon_s < float("inf"):
        raise InputError(f"--horizon {horizon_s:g}: give a positive time in seconds, such as 20")
    for cutoff_s in cutoffs_s:
        if not 0 < cutoff_s <= horizon_s:
            raise InputError(
                f"--cutoff {cutoff_s:g}: give a time above 0 s and at most the horizon "
                f"({horizon_s:g} s)"
            )
    if interval_s is not None and not 0 < interval_s < float("inf"):
        raise InputError(f"--interval {interval_s:g}: give a positive time in seconds, such as 0.1")
    if not 0 < level < 1:
        raise InputError(f"--level {level:g}: give a probability between 0 and 1, such as 0.9")
    if until is not None and not 0 < until < float("inf"):
        raise InputError(f"--until-half-width {until:g}: give a positive percentage, such as 2.5")


def _refuse_pipes(files: Sequence[Path]) -> None:
    for file in files:
        if file.exists() and not (file.is_file() or file.is_dir()):
            raise InputError(
                f"{file}: a pipe can be read only once, and --plot (or --cutoff together with "
                "--until-half-width) reads twice; save the data as a file first"
            )


def _find_own_holds(rig: str) -> Path:
    place = get_holds_path(rig)
    if not place.exists():
        raise InputError(
            f"--rig {rig}: no settled holds are stored yet; `palpate calibrate settling "
            f"RECORDINGS --rig {rig}` cuts them from recordings"
        )
    return place


def _check_held_out(learn_from: Sequence[Path], *, files: Sequence[Path]) -> None:
    predicted = {file.resolve() for file in files}
    for file in learn_from:
        if file.resolve() in predicted:
            raise InputError(
                f"--learn-from {file}: these holds are also predicted, and errors on training "
                "holds are meaningless; give other holds of the sensor"
            )


def _make_methods(
    names: Sequence[str],
    *,
    fit_on: Sequence[Path],
    learn_from: Sequence[Path],
    horizon_s: float,
    percent: bool,
) -> dict[str, SettlingMethod]:
    """Create the methods, trained on the sensor's holds and calibrated on `fit_on`."""
    made = {name: find_method(name) for name in names}
    if learn_from and "relaxation" in made:
        own = _read_settled_holds(learn_from, horizon_s=horizon_s, percent=percent)
        if not own:
            raise InputError(
                f"--learn-from {learn_from[0]}: no hold lasts {horizon_s:g} s, so no settled value "
                "is known; record longer holds"
            )
        if len(own) < MIN_PROOF_HOLDS:
            print_message(
                f"palpate: --learn-from: {len(own)} holds last {horizon_s:g} s; with fewer than "
                f"{MIN_PROOF_HOLDS} a prediction can be worse than without, and is `unproven`"
            )
        made["relaxation"] = Calibrated(holds=tuple(own))
    if not fit_on:
        return made
    holds = _read_settled_holds(fit_on, horizon_s=horizon_s, percent=percent)
    if len(holds) < FEW_CALIBRATION_HOLDS:
        print_message(
            f"palpate: --fit-on: {len(holds)} holds last {horizon_s:g} s; intervals from fewer "
            f"than {FEW_CALIBRATION_HOLDS} holds are inaccurate or missing"
        )
    return {
        name: Calibrated(method=method, holds=holds, learn=False) for name, method in made.items()
    }


def _read_settled_holds(files: Sequence[Path], *, horizon_s: float, percent: bool) -> list[Hold]:
    """Return the holds that last until the horizon."""
    source = HoldSource(paths=files, reading=ReadingOptions(unit="percent" if percent else None))
    return [
        hold
        for file in source.files()
        for hold in source.holds(file, until_s=horizon_s)
        if not isnan(measure_settled_value(hold.time_s, hold.values, horizon_s=horizon_s))
    ]
