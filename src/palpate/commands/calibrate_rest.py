"""`palpate calibrate rest`: what each pixel reads with nothing on it."""

from __future__ import annotations

import json
import sys
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from palpate.commands import options as option
from palpate.errors import CalibrationError
from palpate.files import check_place

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from palpate.sensor.array import ArrayLayout
    from palpate.sensor.calibration import Calibration, RestValues
    from palpate.sensor.health import FrameColumns


def command(
    rig: option.SensorOption = None,
    port: option.PortOption = None,
    out: Annotated[
        Path | None,
        typer.Option(help="File to make or renew. By default the rig file's, or calibration.json."),
    ] = None,
    new: Annotated[
        bool, typer.Option("--new", help="Start a new file: the sensor was changed.")
    ] = False,
    empty: Annotated[
        bool,
        typer.Option(
            "--empty", help="Nothing presses, whatever it reads: weather or wear moved the sheet."
        ),
    ] = False,
    duration_s: Annotated[float, typer.Option("--duration", help="How long.", min=1.0)] = 5.0,
    layout: option.LayoutOption = None,
    reference_ohm: option.ReferenceOption = None,
    rate_hz: option.RateOption = None,
    baud: option.BaudOption = None,
    temperature_c: Annotated[float | None, typer.Option(help="Of the room, where known.")] = None,
    humidity_percent: Annotated[
        float | None, typer.Option(help="Of the room, where known.")
    ] = None,
    as_json: option.JsonOption = False,
) -> None:
    """Take the rest values of every pixel; refused when something presses or moves.

    An existing file keeps its force and block readings.

    Example: palpate calibrate rest --rig rig.toml
    """
    from palpate.commands.calibrate_bench import DEFAULT_FILE, earlier_calibration, new_calibration
    from palpate.commands.sensor_source import open_source

    source = open_source(
        rig=rig,
        port=port,
        layout=layout,
        reference_ohm=reference_ohm,
        rate_hz=rate_hz,
        baud=baud,
    )
    with closing(source):
        path = out or source.calibration_path or DEFAULT_FILE
        check_place(path)
        pixels, simulated = source.array.layout, source.simulated
        earlier = None if new else earlier_calibration(path, layout=pixels, simulated=simulated)
        if not simulated:
            print(f"{source.name}: leave the sensor alone for {duration_s:g} s", file=sys.stderr)
        known_ohm = None if earlier is None or empty else earlier.rest_ohm
        rest = _rest_values(source.frames(duration_s), layout=pixels, known_ohm=known_ohm)
    calibration = new_calibration(pixels, rest=rest, simulated=simulated)
    if earlier is not None:
        # The date is that of the force readings, where there are.
        made_at = earlier.made_at if earlier.force.force_n else calibration.made_at
        calibration = replace(earlier, rest=rest, made_at=made_at)
    if temperature_c is not None:
        calibration = replace(calibration, temperature_c=temperature_c)
    if humidity_percent is not None:
        calibration = replace(calibration, humidity_percent=humidity_percent)
    calibration.save(path)
    renewed = earlier is not None
    if as_json:
        document = _document(calibration, path=path, renewed=renewed)
        print(json.dumps(document, indent=1, allow_nan=False))
    else:
        _print(calibration, path=path, earlier=earlier)


def _rest_values(
    stretch: FrameColumns, *, layout: ArrayLayout, known_ohm: NDArray[np.float64] | None
) -> RestValues:
    """Return the rest values of a stretch, or refuse."""
    import numpy as np

    from palpate.sensor.calibration import RestValues
    from palpate.sensor.findings import pixel_name
    from palpate.signal.relative import refuse_load, rest_baseline

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


def _document(calibration: Calibration, *, path: Path, renewed: bool) -> dict[str, Any]:
    return {
        "file": str(path),
        "renewed": renewed,
        "simulated": calibration.origin == "simulated",
        "layout": calibration.layout.name,
        "rest_ohm": calibration.rest.ohm,
        "spread_percent": calibration.rest.spread_percent,
        "frames": calibration.rest.frames,
        "made_at": calibration.made_at,
    }


def _print(calibration: Calibration, *, path: Path, earlier: Calibration | None) -> None:
    from rich.console import Console
    from rich.table import Table

    from palpate.sensor.findings import pixel_name

    layout, rest = calibration.layout, calibration.rest
    simulated = "  [bold yellow]SIMULATED[/]" if calibration.origin == "simulated" else ""
    table = Table(box=None, padding=(0, 3, 0, 0), show_edge=False, header_style="dim")
    table.add_column("pixel")
    for name in ("finger", "rest, ohm", "spread", "since before"):
        if name != "since before" or earlier is not None:
            table.add_column(name, justify="right")
    for row in range(layout.rows):
        for col in range(layout.cols):
            ohm = rest.ohm[row][col]
            cells = [
                pixel_name(row, col),
                str(layout.finger_of_row[row]),
                f"{ohm:.0f}",
                f"{rest.spread_percent[row][col]:.2f} %",
            ]
            if earlier is not None:
                cells.append(f"{100.0 * (ohm / earlier.rest.ohm[row][col] - 1.0):+.1f} %")
            table.add_row(*cells)
    console = Console(highlight=False)
    console.print(f"[bold]Rest of {layout.name}[/], {rest.frames} frames{simulated}\n")
    console.print(table)
    console.print(f"\n{'Renewed' if earlier is not None else 'Written'}: {path}", soft_wrap=True)
