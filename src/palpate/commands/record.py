"""`palpate record FILE`: frames of a board into a recording."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from palpate.errors import DeviceError, InputError

if TYPE_CHECKING:
    from palpate.recording import LoadCells, RecordingInfo
    from palpate.sensor.array import ArrayLayout
    from palpate.sensor.serial_array import SerialArray


def record(
    file: Annotated[Path, typer.Argument(help="The new recording.")] = Path("recording.mcap"),
    port: Annotated[
        str | None, typer.Option(help="Serial port. [default: found by USB id, or by asking]")
    ] = None,
    layout: Annotated[
        str, typer.Option(help="rigid-2x2, soft-3x2, or rows x columns such as 4x4.")
    ] = "rigid-2x2",
    reference_ohm: Annotated[float, typer.Option(help="The divider's resistor.")] = 4700.0,
    rate_hz: Annotated[float, typer.Option(help="Frames per second.")] = 250.0,
    oversampling: Annotated[int, typer.Option(help="Conversions per pixel.", min=1, max=64)] = 1,
    baud: Annotated[int, typer.Option(help="Speed that the firmware was built for.")] = 1_000_000,
    seconds: Annotated[float, typer.Option(help="How long. [default: until Ctrl-C]")] = math.inf,
    load_cells: Annotated[
        bool, typer.Option("--load-cells", help="Record the reference load cells too.")
    ] = False,
) -> None:
    """Record the frames of a board. The file is readable at any moment, whatever happens.

    Example: palpate record apple.mcap --port /dev/ttyACM0 --seconds 30
    """
    from palpate.clock import RealClock
    from palpate.recording import RecordingWriter
    from palpate.recording.capture import capture
    from palpate.sensor.byte_stream import SerialStream
    from palpate.sensor.ports import find_port, follow, serial_ports
    from palpate.sensor.serial_array import SerialArray
    from palpate.sensor.wire_messages import Contents

    clock = RealClock()

    def open_stream(name: str) -> SerialStream:
        return SerialStream(name, baud=baud)

    pixels = _layout(layout, reference_ohm=reference_ohm)
    name = port or find_port(serial_ports(), clock=clock, open_stream=open_stream)
    where = follow(name)
    array = SerialArray(
        open_stream(name),
        clock=clock,
        layout=pixels,
        rate_hz=rate_hz,
        oversampling=oversampling,
        contents=Contents.LOAD_CELLS if load_cells else Contents.PIXELS,
        reopen=lambda: open_stream(where()),
    )
    try:
        with RecordingWriter(file, info=_info(array)) as writer:
            _say(f"recording {name} to {file}; Ctrl-C ends it")
            capture(
                array,
                writer=writer,
                clock=clock,
                duration_s=seconds,
                load_cells=_cells(array),
                report=_say,
            )
    finally:
        count = array.counters
        array.close()
        _say(
            f"{file}: {count.frames} frames, {count.lost} lost, {count.corrupt} packets corrupt, "
            f"{count.late} late, {count.reconnects} reconnects"
        )


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _layout(name: str, *, reference_ohm: float) -> ArrayLayout:
    from dataclasses import replace

    from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout
    from palpate.signal.circuit import Divider

    divider = Divider(reference_ohm=reference_ohm)
    for known in (RIGID_LAYOUT, SOFT_LAYOUT):
        if name == known.name:
            return replace(known, divider=divider)
    rows, _, cols = name.partition("x")
    if not (rows.isdecimal() and cols.isdecimal() and 0 < int(rows) < 17 and 0 < int(cols) < 17):
        raise InputError(
            f"--layout {name}: give rigid-2x2, soft-3x2, or rows x columns from 1x1 to 16x16"
        )
    return ArrayLayout(
        name=name, rows=int(rows), cols=int(cols), finger_of_row=(0,) * int(rows), divider=divider
    )


def _info(array: SerialArray) -> RecordingInfo:
    from palpate import __version__
    from palpate.recording import RecordingInfo

    board = array.identity
    if board is None:
        raise DeviceError("the board was unplugged before the recording began")
    return RecordingInfo(
        layout=array.layout,
        origin="hardware",
        firmware_version=".".join(map(str, board.version)),
        versions={"palpate": __version__},
        clock_zero_unix_ns=time.time_ns() - time.monotonic_ns(),
    )


def _cells(array: SerialArray) -> Callable[[], LoadCells | None]:
    """Return a function that gives each new pair of load-cell readings once."""
    from palpate.recording import LoadCells
    from palpate.sensor.wire_messages import NO_READING

    seen: list[int] = []

    def newest() -> LoadCells | None:
        cells = array.load_cells
        samples = [cell.sample for cell in cells]
        if samples == seen or all(cell.raw == NO_READING for cell in cells):
            return None
        seen[:] = samples
        return LoadCells(time_s=array.newest_s, raw=tuple(cell.raw for cell in cells))

    return newest
