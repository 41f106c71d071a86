"""Boards that print one line of readings per frame, like most Arduino sketches.

A rig file refers to `open_board` in its `[array]` section.
"""

from __future__ import annotations

import re
from typing import Literal

import numpy as np

from palpate.errors import InputError
from palpate.sensor.array import MAX_LINES, ArrayLayout, IdleLines
from palpate.sensor.board_array import find_layout
from palpate.sensor.one_way_array import Counts, OneWayArray

#: Resistances are stored as counts of this divider: one count is at most 0.03 % from 1 ohm to
#: 10 megohm.
_OHM_BITS, _OHM_REFERENCE = 24, 4700.0
#: Longer than any line of 64 x 64 numbers with their labels.
_LONGEST_BYTES = 1 << 16
_LABEL = re.compile(r"[^\s,;:=]*[A-Za-z_][^\s,;:=]*\s*[:=]\s*")
_BETWEEN = re.compile(r"[,;\s]+")
#: Arduino prints an overflowing float as "ovf".
_READING = re.compile(r"\d|inf|ovf")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|inf|ovf")


class LineDecoder:
    """Finds frames in lines of text.

    A line contains all pixels row by row, or one row with a blank line between frames. Numbers are
    separated by commas, semicolons, tabs or spaces; labels (``A0:512``) and brackets are ignored.
    A line without numbers counts as a blank line. All other lines are rejected and counted,
    including incomplete lines and lines with a number out of range.

    Parameters
    ----------
    layout : ArrayLayout
        Rows, columns and converter.
    columns : list of int, optional
        Positions of the pixels in a line, from 1, in the order of the layout. Numbers at other
        positions are ignored. By default a line contains only the pixels.
    in_ohm : bool
        Whether the numbers are resistances instead of counts.

    Examples
    --------
    >>> pair = ArrayLayout(name="pair", rows=1, cols=2, finger_of_row=(0,))
    >>> decoder = LineDecoder(pair)
    >>> [frame.tolist() for frame in decoder.feed(b"12,300\\n511,300\\n51,2,300\\n512, 301\\n")]
    [[[511, 300]], [[512, 301]]]
    >>> decoder.corrupt, decoder.fault
    (1, '"51,2,300" has 3 numbers, but layout pair needs 2; check layout and columns')
    """

    def __init__(
        self, layout: ArrayLayout, *, columns: list[int] | None = None, in_ohm: bool = False
    ) -> None:
        self._layout = layout
        self._columns = columns
        self._in_ohm = in_ohm
        self._rest = b""
        self._is_synchronized = False
        #: With `columns`: numbers per line, from the first two lines that agree; and in the last.
        self._width = self._last_width = 0
        #: Whether a line contained a complete frame. Otherwise `_rows` collects a frame by rows,
        #: from the first blank line on.
        self._by_line = False
        self._rows: list[list[float]] | None = None
        self.corrupt = 0
        self.fault = ""

    def feed(self, data: bytes) -> list[Counts]:
        """Append bytes and return the completed frames, shape (rows, cols) each."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _LONGEST_BYTES:
            self._rest = b""
            self.corrupt += 1
        frames = []
        for line in lines:
            if not self._is_synchronized:
                self._is_synchronized = True  # the first line can be incomplete
                continue
            try:
                frame = self._read_line(line)
            except ValueError as error:
                self.corrupt += 1
                excerpt = line[:40].strip().decode("ascii", errors="replace")
                self.fault = f'"{excerpt}{"..." if len(line) > 40 else ""}" {error}'
            else:
                frames += [] if frame is None else [frame]
        return frames

    def _read_line(self, line: bytes) -> Counts | None:
        """Parse a line; return the completed frame, or None.

        Raises `ValueError` if the line is invalid, with the fault.
        """
        text = line.decode("ascii", errors="replace").strip()
        if "\ufffd" in text or not text.replace("\t", " ").isprintable():
            raise ValueError("is not text; check the baud rate (baud in the rig file)")
        if not _READING.search(text):
            rows, self._rows = len(self._rows or ()), []
            if rows % self._layout.rows:
                raise ValueError(f"ends a frame after {rows} rows")
            return None
        fields = _BETWEEN.split(_LABEL.sub("", text).strip(" \t,;[](){}"))
        if not all(_NUMBER.fullmatch(field) for field in fields):
            raise ValueError("is not a line of numbers")
        values = [float(field.replace("ovf", "inf")) for field in fields]
        if self._columns is not None:
            values = self._select_columns(values)
        elif len(values) == self._layout.cols < self._layout.pixels and not self._by_line:
            return self._add_row(values)
        if len(values) != self._layout.pixels:
            raise ValueError(
                f"has {len(values)} numbers, but layout {self._layout.name} needs "
                f"{self._layout.pixels}; check layout and columns"
            )
        self._by_line = True
        return self._to_counts(values)

    def _select_columns(self, values: list[float]) -> list[float]:
        """Return the pixels of a line; require the length of two earlier lines."""
        assert self._columns is not None
        if len(values) == self._last_width >= max(self._columns):
            self._width = self._width or len(values)
        self._last_width = len(values)
        if len(values) != self._width:
            needed = self._width or f"at least {max(self._columns)}"
            raise ValueError(f"has {len(values)} numbers instead of {needed}; check columns")
        return [values[column - 1] for column in self._columns]

    def _add_row(self, values: list[float]) -> Counts | None:
        if self._rows is None:
            # No blank line yet: the frame began before the port was open, or none is ever sent.
            self.fault = "the lines are rows, but no blank line marks the start of a frame"
            return None
        if len(self._rows) == self._layout.rows:
            self._rows = None
            raise ValueError(
                f"is row {self._layout.rows + 1}, but the layout has {self._layout.rows} rows"
            )
        self._rows.append(values)
        if len(self._rows) < self._layout.rows:
            return None
        return self._to_counts([value for row in self._rows for value in row])

    def _to_counts(self, values: list[float]) -> Counts:
        numbers, divider = np.array(values), self._layout.divider
        top = divider.full_scale - 1
        if self._in_ohm:
            if (numbers < 0).any():
                raise ValueError("has a negative resistance")
            fraction = _OHM_REFERENCE / (_OHM_REFERENCE + numbers)
            numbers = np.minimum(fraction * divider.full_scale, top)
        if (numbers < 0).any() or (numbers > top).any():
            raise ValueError(
                f"is outside 0 to {top}, the range of {divider.adc_bits} bits (adc_bits)"
            )
        counts: Counts = np.rint(numbers).astype(np.int32)
        return counts.reshape(self._layout.rows, self._layout.cols)


def open_board(
    *,
    port: str,
    layout: str,
    baud: int = 115200,
    unit: Literal["counts", "ohm"] = "counts",
    adc_bits: int = 10,
    reference_ohm: float = 4700.0,
    taxel_leg: Literal["upper", "lower"] = "upper",
    idle_lines: IdleLines = "isolated",
    fingers: int = 1,
    columns: list[int] | None = None,
) -> OneWayArray:
    """Open the array of a board that prints its readings.

    The array reconnects after a disconnection.

    Parameters
    ----------
    port : str
        Device, e.g. ``"/dev/ttyUSB0"``.
    layout, fingers
        Rows x columns of the matrix, e.g. ``"4x2"``, as in
        `palpate.sensor.board_array.find_layout`.
    baud : int
        Baud rate of the board's program.
    unit : {"counts", "ohm"}
        Unit of the printed numbers: counts of the board's converter, or resistances.
    adc_bits, reference_ohm, taxel_leg
        Converter and divider of the counts; not used for ohms.
    idle_lines : {"isolated", "floating", "held"}
        State of the unselected lines during a reading (`ArrayLayout`).
    columns : list of int, optional
        Positions of the pixels in a line (`LineDecoder`).

    Raises
    ------
    InputError
        If the layout is unknown, or `columns` does not fit it.
    DeviceError
        If the port can't be opened, or no frame arrives.
    """
    in_ohm = unit == "ohm"
    if in_ohm and idle_lines == "held":
        raise InputError('idle_lines = "held" needs counts: print counts instead of ohms')
    pixels = find_layout(
        layout,
        reference_ohm=_OHM_REFERENCE if in_ohm else reference_ohm,
        taxel_leg="upper" if in_ohm else taxel_leg,
        idle_lines=idle_lines,
        fingers=fingers,
        adc_bits=_OHM_BITS if in_ohm else adc_bits,
        max_lines=MAX_LINES,
    )
    if columns is not None:
        wrong = [n for n in columns if type(n) is not int or n < 1 or columns.count(n) > 1]
        if wrong or len(columns) != pixels.pixels:
            raise InputError(
                f"columns = {columns}: give {pixels.pixels} different positive integers, one "
                f"for each pixel of layout {layout}"
            )
    decoder = LineDecoder(pixels, columns=columns, in_ohm=in_ohm)
    return OneWayArray.open_port(port, baud=baud, layout=pixels, decoder=decoder)
