"""`palpate calibrate rest`: rest resistance of each pixel."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Annotated

from palpate.calibrate.rest import compute_rest, replace_rest
from palpate.calibration import Calibration
from palpate.cli import options as option
from palpate.cli.calibrate_bench import DEFAULT_FILE, load_earlier_calibration
from palpate.cli.options import opt
from palpate.cli.output import print_json, print_message
from palpate.cli.sensor_source import open_source
from palpate.files import check_writable
from palpate.sensor.findings import pixel_name
from palpate.terminal_table import make_console, print_table


def calibrate_rest(
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    out: option.CalibrationOption = None,
    new: Annotated[bool, opt("--new", "Start a new file, after the sensor was changed.")] = False,
    empty: Annotated[
        bool,
        opt(
            "--empty",
            "Accept changed rest values: nothing touches the sensor, but temperature, humidity or "
            "wear changed the readings.",
        ),
    ] = False,
    duration_s: Annotated[float, opt("--duration SECONDS", "Measuring time.", min=1.0)] = 5.0,
    as_json: option.JsonOption = False,
) -> None:
    """Measure the rest resistance of each pixel; fails if the sensor is loaded or drifting.

    Force and block readings of an existing file are preserved.

    Example: palpate calibrate rest --rig rig.toml
    """
    source = open_source(rig, port=port)
    with closing(source):
        path = out or source.calibration_path or DEFAULT_FILE
        check_writable(path)
        pixels, simulated = source.array.layout, source.simulated
        earlier = (
            None if new else load_earlier_calibration(path, layout=pixels, simulated=simulated)
        )
        if not simulated:
            print_message(f"{source.name}: do not touch the sensor for {duration_s:g} s")
        known_ohm = None if earlier is None or empty else earlier.rest_ohm
        values = compute_rest(source.frames(duration_s), layout=pixels, known_ohm=known_ohm)
    calibration = replace_rest(earlier, values, layout=pixels, simulated=simulated)
    calibration.save(path)
    if as_json:
        print_json(
            {
                "file": str(path),
                "renewed": earlier is not None,
                "simulated": calibration.origin == "simulated",
                "layout": calibration.layout.name,
                "rest_ohm": calibration.rest.ohm,
                "spread_percent": calibration.rest.spread_percent,
                "frames": calibration.rest.frames,
                "made_at": calibration.made_at,
            }
        )
    else:
        _print(calibration, path=path, earlier=earlier)


def _print(calibration: Calibration, *, path: Path, earlier: Calibration | None) -> None:
    layout, values = calibration.layout, calibration.rest
    renewed = earlier is not None
    rows = []
    for row in range(layout.rows):
        for col in range(layout.cols):
            ohm, before = values.ohm[row][col], earlier and earlier.rest.ohm[row][col]
            rows.append(
                (
                    pixel_name(row, col),
                    str(layout.finger_of_row[row]),
                    f"{ohm:.0f}",
                    f"{values.spread_percent[row][col]:.2f} %",
                    *([f"{100.0 * (ohm / before - 1.0):+.1f} %"] if before else []),
                )
            )
    simulated = "  [bold yellow]SIMULATED[/]" if calibration.origin == "simulated" else ""
    console = make_console()
    console.print(f"[bold]Rest values of {layout.name}[/], {values.frames} frames{simulated}\n")
    columns = ("pixel", ">finger", ">rest, ohm", ">spread", *[">since before"] * renewed)
    print_table(columns, rows, console=console)
    console.print(f"\n{'Renewed' if renewed else 'Written'}: {path}", soft_wrap=True)
