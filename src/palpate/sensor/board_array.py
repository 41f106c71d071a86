"""A board's pressure array, opened by port, layout, resistor and rate.

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
from palpate.sensor.ports import find_port, follow_port, serial_ports
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import MAX_SIDE, Contents
from palpate.signal.circuit import Divider

#: The paper's arrays (section 2.1 and 4.2), by name.
LAYOUTS = {layout.name: layout for layout in (RIGID_LAYOUT, SOFT_LAYOUT)}


def find_layout(
    name: str,
    *,
    reference_ohm: float = 4700.0,
    taxel_leg: Literal["upper", "lower"] = "upper",
    idle_lines: IdleLines = "isolated",
    line_ohm: float = 0.0,
    fingers: int = 1,
    pitch_mm: float | None = None,
    adc_bits: int = 10,
    most_lines: int = MAX_SIDE,
) -> ArrayLayout:
    """Return a preset layout, or one of rows x columns, with its divider and wiring.

    Parameters
    ----------
    name : str
        ``"rigid-2x2"``, ``"soft-3x2"``, or the whole matrix, e.g. ``"6x3"``.
    reference_ohm : float
        The divider's fixed resistor.
    taxel_leg : {"upper", "lower"}
        Where the pixel lies in the divider.
    idle_lines : {"isolated", "floating", "held"}
        What the lines of the other pixels do while one is read (`ArrayLayout`).
    line_ohm : float
        In series with every pixel: the multiplexers' on-resistance.
    fingers : int
        How many fingers the rows of a matrix are on, as many on each; presets know theirs.
    pitch_mm : float, optional
        Distance between the centres of neighbouring pixels; 10 by default.
    adc_bits : int
        Width of the board's converter.
    most_lines : int
        Largest number of rows, and of columns, that the board reads.

    Raises
    ------
    InputError
        If there is no such layout, or a value makes no sense.

    Examples
    --------
    Two fingers with three rows of three pixels each:

    >>> find_layout("soft-3x2").pixels, find_layout("6x3", fingers=2).finger_of_row
    (12, (0, 0, 0, 1, 1, 1))
    """
    if not reference_ohm > 0:
        raise InputError(f"the reference resistor must be above 0 ohm, not {reference_ohm:g}")
    if not 1 <= adc_bits <= 24:
        raise InputError(f"adc_bits = {adc_bits}: a converter has 1 to 24 bits")
    divider = Divider(reference_ohm=reference_ohm, taxel_leg=taxel_leg, adc_bits=adc_bits)
    if pitch_mm is not None and not 0 < pitch_mm < math.inf:
        raise InputError(f"a pitch of {pitch_mm:g} mm: give millimetres between pixel centres")
    layout = LAYOUTS.get(name) or _make_grid(name, fingers=fingers, most_lines=most_lines)
    if fingers not in (1, layout.fingers):
        raise InputError(f"layout {name} is on {layout.fingers} fingers, not on {fingers}")
    try:
        return replace(
            layout,
            divider=divider,
            idle_lines=idle_lines,
            line_ohm=line_ohm,
            pitch_mm=pitch_mm or layout.pitch_mm,
        )
    except ValueError as error:
        raise InputError(str(error)) from error


def _make_grid(name: str, *, fingers: int, most_lines: int) -> ArrayLayout:
    """Return the layout of rows x columns, the rows shared equally by the fingers."""
    rows, _, cols = name.partition("x")
    sizes = [int(side) for side in (rows, cols) if side.isdecimal()]
    if len(sizes) != 2 or not all(1 <= size <= most_lines for size in sizes):
        raise InputError(
            f"no layout {name!r}: give {', '.join(LAYOUTS)}, or rows x columns from 1x1 to "
            f"{most_lines}x{most_lines}"
        )
    if fingers < 1 or sizes[0] % fingers:
        raise InputError(
            f"layout {name}: {sizes[0]} rows cannot be shared equally by {fingers} fingers"
        )
    each = sizes[0] // fingers
    return ArrayLayout(
        name=name,
        rows=sizes[0],
        cols=sizes[1],
        finger_of_row=tuple(row // each for row in range(sizes[0])),
    )


def check_rate(rate_hz: float) -> None:
    """Refuse a frame rate that is not positive and finite.

    Raises `InputError` if it is not above 0, or without end.
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
    fingers: int = 1,
    pitch_mm: float | None = None,
    rate_hz: float = 250.0,
    oversampling: int = 1,
    baud: int = BAUD,
    load_cells: bool = False,
    pressure: bool = False,
    servo: bool = False,
) -> SerialArray:
    """Open the array of a board with palpate's firmware; it reconnects after an unplug.

    Parameters
    ----------
    port : str, optional
        Device, e.g. ``"/dev/ttyACM0"``; by default found by USB id, or by asking who answers.
    layout, reference_ohm, taxel_leg, idle_lines, line_ohm, fingers, pitch_mm
        As in `find_layout`.
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
    servo : bool
        Whether the board's servo pulses are read too, for fingers driven by a hobby servo.

    Raises
    ------
    InputError
        If there is no such layout, or the rate is none.
    DeviceError
        If there is no board, it does not answer, or it can't do that rate.
    """
    check_rate(rate_hz)
    pixels = find_layout(
        layout,
        reference_ohm=reference_ohm,
        taxel_leg=taxel_leg,
        idle_lines=idle_lines,
        line_ohm=line_ohm,
        fingers=fingers,
        pitch_mm=pitch_mm,
    )
    clock = RealClock()

    def open_stream(name: str) -> SerialStream:
        return SerialStream(name, baud=baud)

    device = port or find_port(serial_ports(), clock=clock, open_stream=open_stream)
    where = follow_port(device)
    return SerialArray(
        open_stream(device),
        clock=clock,
        layout=pixels,
        rate_hz=rate_hz,
        oversampling=oversampling,
        contents=(Contents.LOAD_CELLS if load_cells else Contents.PIXELS)
        | (Contents.PRESSURE if pressure else Contents.PIXELS)
        | (Contents.SERVO if servo else Contents.PIXELS),
        reopen=lambda: open_stream(where()),
    )
