"""`palpate force`: newtons from readings with weights, a column of loads or a load cell."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from palpate.calibrate.loaded_readings import read_loaded
from palpate.calibrate.loaded_sensor import LoadedSensor, TableOptions
from palpate.calibrate.recorded_force import (
    FittedForce,
    fit_sensor,
    make_calibration,
    use_calibration,
)
from palpate.calibration import Calibration
from palpate.cli import options as option
from palpate.cli.force_report import ForceReport, print_report
from palpate.cli.options import JsonOption, opt
from palpate.cli.output import check_table_file, print_json, print_message, write_table
from palpate.cli.settle_source import Leg, make_divider, parse_rest
from palpate.errors import InputError
from palpate.files import check_not_input, check_writable
from palpate.holds.recordings import stem_of
from palpate.plots.force_trace import force_trace_figure
from palpate.plots.style import check_plot, save_figure
from palpate.signal.circuit import Divider


def force(
    readings: Annotated[
        Path,
        typer.Argument(
            help="Readings: CSV, TSV, Excel, Parquet, gzipped or not, or a recording (.mcap). "
            "Without a clock, each row is a settled reading.",
            metavar="READINGS",
        ),
    ],
    weights: Annotated[
        Path | None,
        opt(
            "--weights FILE",
            "Weights in the order in which they were on the sensor: a column load_n, weight_g or "
            "weight_kg, and optionally a time of each.",
        ),
    ] = None,
    load_cell: Annotated[
        Path | None,
        opt("--load-cell FILE", "Times and loads of a load cell, on the clock of the readings."),
    ] = None,
    calibration: Annotated[
        Path | None,
        opt("--calibration FILE", "Use this calibration file; the loads are then unknown."),
    ] = None,
    load_column: Annotated[
        str | None,
        opt("--load-column NAME", "Column of loads. [default: from common names]"),
    ] = None,
    load_unit: Annotated[
        Literal["N", "g", "kg"] | None,
        opt("--load-unit UNIT", "N, g or kg. [default: from the column's name]"),
    ] = None,
    save: Annotated[
        Path | None,
        opt(
            "--save FILE",
            "Create or update a calibration file, for `palpate live --force` and a rig.",
        ),
    ] = None,
    output: Annotated[
        Path | None,
        opt("--output FILE", "Write the newtons of each reading: .csv, .parquet or .json."),
    ] = None,
    plot: option.PlotOption = None,
    rest: Annotated[
        str | None,
        opt("--rest START:END", "Interval without load, seconds. [default: from the loads]"),
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
            "Column of a pixel; may be repeated. [default: from common names]",
        ),
    ] = None,
    unit: option.UnitOption = None,
    adc_bits: Annotated[
        int | None, opt("--adc-bits N", "Resolution of the converter of counts.", min=1, max=32)
    ] = None,
    supply_v: Annotated[
        float | None,
        opt("--supply-v VOLTS", "Supply of the voltage divider of readings in volts.", min=0.1),
    ] = None,
    reference_ohm: option.ReferenceOhmOption = None,
    sensor_leg: option.SensorLegOption = None,
    as_json: JsonOption = False,
) -> None:
    """Convert readings to newtons, from weights or a load cell.

    The loads are weights (--weights), a column of the readings, or the file of a load cell
    (--load-cell). Rows without a load are converted too.

    Example: palpate force demo-force/weights.csv --adc-bits 10 --save calibration.json
    """
    inputs = [one for one in (readings, weights, load_cell, calibration) if one is not None]
    check_plot(plot)
    check_table_file(output, option="--output", inputs=inputs)
    if save is not None:
        check_writable(save)
        check_not_input(save, inputs=inputs)
    rest_s = parse_rest(rest, mean=False, unit=unit)
    options = TableOptions(
        time_column=time_column,
        time_unit=time_unit,
        value_columns=tuple(value_column or ()),
        unit=unit,
        divider=_find_divider(
            adc_bits or (None if supply_v is None else 16), reference_ohm, sensor_leg, unit=unit
        ),
        adc_bits=adc_bits,
        supply_v=supply_v,
        interval_s=interval,
        sheet=sheet,
        decimal=decimal,
        load_column=load_column,
        load_unit=load_unit,
    )
    if calibration is not None:
        option.refuse_options(
            {"--weights": weights, "--load-cell": load_cell, "--save": save, "--rest": rest},
            why="--calibration has the law already; omit one of the two",
        )
        known = Calibration.load(calibration)
        sensors = _read_for(known, readings, options)
        fits = [use_calibration(known, one, name=str(calibration)) for one in sensors]
    else:
        sensors = read_loaded(readings, weights=weights, load_cell=load_cell, options=options)
        fits = [fit_sensor(one, rest_s=rest_s) for one in sensors]
    found = [
        ForceReport(sensor=one, fitted=fit, traces=fit.traces(one))
        for one, fit in zip(sensors, fits, strict=True)
    ]
    _save(save, sensors, fits)
    if output is not None:
        write_table(output, [row for one in found for row in one.rows()])
    if plot is not None:
        save_figure(force_trace_figure([one.drawn() for one in found]), plot)
    for one in found:
        for remark in one.sensor.remarks:
            print_message(f"palpate: {remark.removeprefix('palpate: ')}")
    if as_json:
        print_json({"file": str(readings), "sensors": [one.to_dict() for one in found]})
    else:
        print_report(found, written=[one for one in (save, output, plot) if one is not None])


def _find_divider(
    adc_bits: int | None, reference_ohm: float | None, leg: Leg | None, *, unit: str | None
) -> Divider | None:
    """Return the divider of counts; None with the bits alone, which suffice for a force."""
    if reference_ohm is None and leg is None:
        return None
    return make_divider(adc_bits, reference_ohm, leg, unit=unit)


def _read_for(
    calibration: Calibration, readings: Path, options: TableOptions
) -> list[LoadedSensor]:
    """Return the readings for a calibration; their counts have its divider by default."""
    if options.divider is None:
        options = TableOptions(
            **{
                name: getattr(options, name)
                for name in TableOptions.__slots__
                if name not in ("divider", "adc_bits")
            },
            divider=calibration.layout.divider,
        )
    return read_loaded(readings, options=options, require_loads=False)


def _save(save: Path | None, sensors: Sequence[LoadedSensor], fits: Sequence[FittedForce]) -> None:
    """Write the calibration file of the only sensor."""
    if save is None:
        return
    if len(fits) > 1:
        names = ", ".join(one.name for one in sensors)
        raise InputError(f"--save: a file is for one sensor; the table has {names[:120]}")
    earlier = Calibration.load(save) if save.exists() else None
    try:
        made = make_calibration(fits[0], earlier=earlier, name=stem_of(save.name))
    except InputError as error:
        raise InputError(f"--save {save}: {error}") from error
    made.save(save)
