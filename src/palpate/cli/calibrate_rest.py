"""`palpate calibrate rest`: the reading of each pixel without load."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from palpate.cli import options as option
from palpate.cli.calibrate_bench import DEFAULT_FILE, earlier_calibration, new_calibration
from palpate.cli.options import opt
from palpate.cli.output import print_json, say
from palpate.cli.sensor_source import open_source
from palpate.errors import CalibrationError
from palpate.files import check_place
from palpate.sensor.array import ArrayLayout
from palpate.sensor.calibration import Calibration, RestValues
from palpate.sensor.findings import pixel_name
from palpate.sensor.health import FrameColumns
from palpate.signal.relative import refuse_load, rest_baseline
from palpate.terminal_table import print_table


def rest(
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    out: option.CalibrationOption = None,
    new: Annotated[bool, opt("--new", "Start a new file: the sensor was changed.")] = False,
    empty: Annotated[
        bool, opt("--empty", "Nothing presses, though temperature, humidity or wear moved it.")
    ] = False,
    duration_s: Annotated[float, opt("--duration SECONDS", "How long.", min=1.0)] = 5.0,
    as_json: option.JsonOption = False,
) -> None:
    """Take the rest values of every pixel; refused when something presses or moves.

    An existing file keeps its force and block readings.

    Example: palpate calibrate rest --rig rig.toml
    """
    source = open_source(rig, port=port)
    with closing(source):
        path = out or source.calibration_path or DEFAULT_FILE
        check_place(path)
        pixels, simulated = source.array.layout, source.simulated
        earlier = None if new else earlier_calibration(path, layout=pixels, simulated=simulated)
        if not simulated:
            say(f"{source.name}: leave the sensor alone for {duration_s:g} s")
        known_ohm = None if earlier is None or empty else earlier.rest_ohm
        values = _rest_values(source.frames(duration_s), layout=pixels, known_ohm=known_ohm)
    calibration = new_calibration(pixels, rest=values, simulated=simulated)
    if earlier is not None:
        # The date is that of the force readings, where there are.
        made_at = earlier.made_at if earlier.force.force_n else calibration.made_at
        calibration = replace(earlier, rest=values, made_at=made_at)
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


def _rest_values(
    stretch: FrameColumns, *, layout: ArrayLayout, known_ohm: NDArray[np.float64] | None
) -> RestValues:
    """Return the rest values of a stretch, or refuse."""
    ohm, middle_ohm = stretch.ohm(layout=layout), stretch.rest_ohm(layout=layout)
    rest = rest_baseline(ohm)
    if known_ohm is not None:
        try:
            refuse_load(rest.rest_ohm, known_ohm=known_ohm)
        except CalibrationError as loaded:
            raise CalibrationError(f"{loaded} (--new); if nothing does, give --empty") from loaded
    useless = np.isnan(rest.rest_ohm) | np.isinf(middle_ohm) | (middle_ohm == 0)
    dead = [pixel_name(int(row), int(col)) for row, col in np.argwhere(useless)]
    if dead:
        raise CalibrationError(
            f"no rest value for {', '.join(dead)}: open or short; run `palpate doctor`"
        )
    return RestValues(
        ohm=tuple(map(tuple, rest.rest_ohm.round(3).tolist())),
        # The plain deviation: a robust one is 0 where the noise is within a count.
        spread_percent=tuple(
            map(tuple, (100.0 * ohm.std(axis=0) / rest.rest_ohm).round(4).tolist())
        ),
        frames=rest.frames,
    )


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
    console = Console(highlight=False)
    console.print(f"[bold]Rest of {layout.name}[/], {values.frames} frames{simulated}\n")
    columns = ("pixel", ">finger", ">rest, ohm", ">spread", *[">since before"] * renewed)
    print_table(columns, rows, console=console)
    console.print(f"\n{'Renewed' if renewed else 'Written'}: {path}", soft_wrap=True)
