"""Opening of the pressure array of a board with palpate's firmware.

A rig file refers to `open_board` in its `[array]` section.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

from palpate.clock import RealClock
from palpate.errors import InputError
from palpate.sensor.array import RIGID_LAYOUT, SOFT_LAYOUT, ArrayLayout, IdleLines
from palpate.sensor.byte_stream import BAUD, SerialStream
from palpate.sensor.ports import find_port, list_serial_ports, make_port_finder
from palpate.sensor.serial_array import SerialArray
from palpate.sensor.wire_messages import MAX_SIDE, Contents
from palpate.signal.circuit import Divider

#: The paper's arrays, by name.
LAYOUTS = {layout.name: layout for layout in (RIGID_LAYOUT, SOFT_LAYOUT)}
#: Range of the rate in the firmware's command: millihertz in 32 bits.
_LOWEST_HZ, _HIGHEST_HZ = 1e-3, (2**32 - 1) / 1e3
#: Largest number of conversions that the firmware sums.
_MOST_CONVERSIONS = 64


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
    max_lines: int = MAX_SIDE,
) -> ArrayLayout:
    """Return a preset or rows x columns layout with its divider and wiring.

    Parameters
    ----------
    name : str
        ``"rigid-2x2"``, ``"soft-3x2"``, or the size of the matrix, e.g. ``"6x3"``.
    reference_ohm : float
        The divider's fixed resistor.
    taxel_leg : {"upper", "lower"}
        Position of the pixel in the divider.
    idle_lines : {"isolated", "floating", "held"}
        State of the unselected lines during a reading (`ArrayLayout`).
    line_ohm : float
        Resistance in series with every pixel, such as that of the multiplexers.
    fingers : int
        Number of fingers, each with the same number of rows. Presets define their own.
    pitch_mm : float, optional
        Distance between the centres of adjacent pixels; 10 by default.
    adc_bits : int
        Resolution of the board's converter.
    max_lines : int
        Largest number of rows or columns that the board can read.

    Raises
    ------
    InputError
        If the layout is unknown or a value is out of range.

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
    if pitch_mm is not None and not 0 < pitch_mm < math.inf:
        raise InputError(
            f"pitch_mm = {pitch_mm:g}: give the distance between pixel centres, above 0 mm"
        )
    layout = LAYOUTS.get(name) or _make_grid(name, fingers=fingers, max_lines=max_lines)
    if fingers not in (1, layout.fingers):
        raise InputError(f"layout {name} has {layout.fingers} fingers, not {fingers}")
    try:
        return replace(
            layout,
            divider=Divider(reference_ohm=reference_ohm, taxel_leg=taxel_leg, adc_bits=adc_bits),
            idle_lines=idle_lines,
            line_ohm=line_ohm,
            pitch_mm=pitch_mm or layout.pitch_mm,
        )
    except ValueError as error:
        raise InputError(str(error)) from error


def _make_grid(name: str, *, fingers: int, max_lines: int) -> ArrayLayout:
    """Return a rows x columns layout with the rows divided equally among the fingers."""
    rows, _, cols = name.partition("x")
    sizes = [int(side) for side in (rows, cols) if side.isdecimal()]
    if len(sizes) != 2 or not all(1 <= size <= max_lines for size in sizes):
        raise InputError(
            f"unknown layout {name!r}: give {', '.join(LAYOUTS)}, or rows x columns from 1x1 to "
            f"{max_lines}x{max_lines}"
        )
    if fingers < 1 or sizes[0] % fingers:
        raise InputError(
            f"layout {name}: {sizes[0]} rows cannot be divided equally among {fingers} fingers"
        )
    rows_per_finger = sizes[0] // fingers
    return ArrayLayout(
        name=name,
        rows=sizes[0],
        cols=sizes[1],
        finger_of_row=tuple(row // rows_per_finger for row in range(sizes[0])),
    )


def check_rate(rate_hz: float) -> None:
    """Raise `InputError` if a frame rate is not positive and finite, or can't be sent."""
    if not 0 < rate_hz < math.inf:
        raise InputError(f"frame rate {rate_hz:g} Hz: must be positive and finite, e.g. 250")
    if not _LOWEST_HZ <= rate_hz <= _HIGHEST_HZ:
        raise InputError(
            f"frame rate {rate_hz:g} Hz: must be {_LOWEST_HZ:g} to {_HIGHEST_HZ:.0f} Hz, e.g. 250"
        )


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
    """Open the array of a board with palpate's firmware.

    The array reconnects after a disconnection.

    Parameters
    ----------
    port : str, optional
        Device, e.g. ``"/dev/ttyACM0"``. By default the only board is found, from its USB id or its
        answer.
    layout, reference_ohm, taxel_leg, idle_lines, line_ohm, fingers, pitch_mm
        As in `find_layout`.
    rate_hz : float
        Frames per second.
    oversampling : int
        Conversions summed per pixel, 1 to 64.
    baud : int
        Baud rate of the firmware.
    load_cells : bool
        Whether to read the board's two load cells as well.
    pressure : bool
        Whether to read the board's pressure regulator as well, for pneumatic fingers.
    servo : bool
        Whether to read the board's servo pulses as well, for fingers with a hobby servo.

    Raises
    ------
    InputError
        If the layout is unknown or a number is out of range.
    DeviceError
        If there is no board, the board does not answer, or it cannot reach the rate.
    """
    check_rate(rate_hz)
    if not 1 <= oversampling <= _MOST_CONVERSIONS:
        raise InputError(
            f"oversampling = {oversampling}: the board sums 1 to {_MOST_CONVERSIONS} conversions"
        )
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

    device = port or find_port(list_serial_ports(), clock=clock, open_stream=open_stream)
    find_current_port = make_port_finder(device)
    return SerialArray(
        open_stream(device),
        clock=clock,
        layout=pixels,
        rate_hz=rate_hz,
        oversampling=oversampling,
        contents=(Contents.LOAD_CELLS if load_cells else Contents.PIXELS)
        | (Contents.PRESSURE if pressure else Contents.PIXELS)
        | (Contents.SERVO if servo else Contents.PIXELS),
        reopen=lambda: open_stream(find_current_port()),
    )
