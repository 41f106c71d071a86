"""A board's pressure array by the words of a user: port, layout, resistor, rate.

`open_board` is what a rig file names for its `[array]`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

from palpate.clock import RealClock
from palpate.errors import InputError
from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout, IdleLines
from palpate.sensor.byte_stream import BAUD, SerialStream
from palpate.sensor.ports import find_port, follow, serial_ports
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import Contents
from palpate.signal.circuit import Divider

#: The paper's arrays (section 2.1 and 4.2), by name.
PRESETS = {layout.name: layout for layout in (RIGID_LAYOUT, SOFT_LAYOUT)}
_MOST_LINES = 16


def layout_named(
    name: str,
    *,
    reference_ohm: float = 4700.0,
    taxel_leg: Literal["upper", "lower"] = "upper",
    idle_lines: IdleLines = "isolated",
    line_ohm: float = 0.0,
) -> ArrayLayout:
    """Return a preset layout, or one of rows x columns, with its divider and wiring.

    Parameters
    ----------
    name : str
        ``"rigid-2x2"``, ``"soft-3x2"``, or e.g. ``"4x4"`` (all of it on one finger).
    reference_ohm : float
        The divider's fixed resistor.
    taxel_leg : {"upper", "lower"}
        Where the pixel lies in the divider.
    idle_lines : {"isolated", "floating", "held"}
        What the lines of the other pixels do while one is read (`ArrayLayout`).
    line_ohm : float
        In series with every pixel: the multiplexers' on-resistance.

    Raises
    ------
    InputError
        If there is no such layout, or a value makes no sense.

    Examples
    --------
    >>> layout_named("soft-3x2").pixels, layout_named("4x3", reference_ohm=1e3).rows
    (12, 4)
    """
    if not reference_ohm > 0:
        raise InputError(f"the reference resistor must be above 0 ohm, not {reference_ohm:g}")
    divider = Divider(reference_ohm=reference_ohm, taxel_leg=taxel_leg)
    if name in PRESETS:
        return _wired(PRESETS[name], divider, idle_lines, line_ohm)
    rows, _, cols = name.partition("x")
    sizes = [int(side) for side in (rows, cols) if side.isdecimal()]
    if len(sizes) != 2 or not all(1 <= size <= _MOST_LINES for size in sizes):
        raise InputError(
            f"no layout {name!r}: give {', '.join(PRESETS)}, or rows x columns from 1x1 to 16x16"
        )
    grid = ArrayLayout(name=name, rows=sizes[0], cols=sizes[1], finger_of_row=(0,) * sizes[0])
    return _wired(grid, divider, idle_lines, line_ohm)


def _wired(
    layout: ArrayLayout, divider: Divider, idle_lines: IdleLines, line_ohm: float
) -> ArrayLayout:
    try:
        return replace(layout, divider=divider, idle_lines=idle_lines, line_ohm=line_ohm)
    except ValueError as error:
        raise InputError(str(error)) from error


def check_rate(rate_hz: float) -> None:
    """Refuse a number that no board could take for a rate.

    Raises
    ------
    InputError
        If it is not above 0, or without end.
    """
    if not 0 < rate_hz < math.inf:
        raise InputError(f"a rate of {rate_hz:g} Hz: give frames per second, such as 250")


def open_board(
    *,
    port: str | None = None,
    layout: str = RIGID_LAYOUT.name,
    reference_ohm: float = 4700.0,
    taxel_leg: Literal["upper", "lower"] = "upper",
    idle_lines: IdleLines = "isolated",
    line_ohm: float = 0.0,
    rate_hz: float = 250.0,
    oversampling: int = 1,
    baud: int = BAUD,
    load_cells: bool = False,
    pressure: bool = False,
) -> SerialArray:
    """Open the array of a board with palpate's firmware; it reconnects after an unplug.

    Parameters
    ----------
    port : str, optional
        Device, e.g. ``"/dev/ttyACM0"``; by default found by USB id, or by asking who answers.
    layout, reference_ohm, taxel_leg, idle_lines, line_ohm
        As in `layout_named`.
    rate_hz : float
        Frames per second.
    oversampling : int
        Conversions summed per pixel, 1 to 64.
    baud : int
        Speed that the firmware was built for.
    load_cells : bool
        Whether the board's two load cells are read too.
    pressure : bool
        Whether the board's regulator is read too, for fingers driven by pressure.

    Raises
    ------
    InputError
        If there is no such layout, or the rate is none.
    DeviceError
        If there is no board, it does not answer, or it can't do that rate.
    """
    check_rate(rate_hz)
    pixels = layout_named(
        layout,
        reference_ohm=reference_ohm,
        taxel_leg=taxel_leg,
        idle_lines=idle_lines,
        line_ohm=line_ohm,
    )
    clock = RealClock()

    def open_stream(name: str) -> SerialStream:
        return SerialStream(name, baud=baud)

    device = port or find_port(serial_ports(), clock=clock, open_stream=open_stream)
    where = follow(device)
    return SerialArray(
        open_stream(device),
        clock=clock,
        layout=pixels,
        rate_hz=rate_hz,
        oversampling=oversampling,
        contents=(Contents.LOAD_CELLS if load_cells else Contents.PIXELS)
        | (Contents.PRESSURE if pressure else Contents.PIXELS),
        reopen=lambda: open_stream(where()),
    )
