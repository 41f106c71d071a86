"""Boards that print one line of readings per frame, like most Arduino sketches.

A rig file refers to `open_board` in its `[array]` section.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.sensor.array import MAX_LINES, ArrayLayout, IdleLines
from palpate.sensor.board_array import find_layout
from palpate.sensor.flexitac import MARKER
from palpate.sensor.one_way_array import OPEN_S, Counts, OneWayArray
from palpate.sensor.printed_numbers import FormError, LineSplitter, read_numbers

#: Resistances and voltages are stored as counts of this divider: one count is at most 0.03 % from
#: 1 ohm to 10 megohm.
_FINE_BITS, _OHM_REFERENCE = 24, 4700.0
#: Mean counts have two decimals: they are stored as sums of this many conversions.
_MEAN_OF = 100
#: No board has a higher supply, so fractions up to it can be volts.
_HIGHEST_SUPPLY_V = 5.5
_NO_BLANK = "no blank line marks the start of a frame: print one after each frame"
_NO_NUMBERS = "has no numbers; if the sketch starts slowly, set wait_s in the rig file"
_RARE_LINES = (
    "its only line can be incomplete; if the sketch prints rarely, set wait_s in the rig file"
)
#: A number in front of (or behind) the pixels is a clock if it increases in this many lines in a
#: row, and is above the range of a reading.
_CLOCK_LINES = 8
#: As many lines of a wrong form are no damage. Then the next lines are rejected although they seem
#: valid: a hexadecimal number can have digits only, and a difference can be positive.
_MIN_SUSPECTS, _FORM_LINES = 3, 50
#: Equal numbers of lines between blank lines, after which the lines seem to be rows of a frame.
_ROW_BLOCKS = 3
#: This many markers of FlexiTac's frames do not occur by chance in text at a wrong baud rate.
_MIN_MARKERS = 4
_USUAL_BITS = (8, 10, 12, 14, 16, 18, 24)


class LineDecoder:
    """Finds frames in lines of text.

    A line contains all pixels row by row, or the same part of each frame, with a blank line between
    frames. Numbers can have the forms of `read_numbers`. A line without numbers counts as a blank
    line. All other lines are rejected and counted, including incomplete lines and lines with a
    number out of range.

    Parameters
    ----------
    layout : ArrayLayout
        Rows, columns and converter.
    columns : list of int, optional
        Positions of the pixels in a line, from 1, in the order of the layout. Numbers at other
        positions are ignored. By default a line contains only the pixels, and possibly a clock
        that is recognized by its increase.
    in_ohm : bool
        Whether the numbers are resistances instead of counts.
    supply_v : float, optional
        Whether the numbers are voltages, and the supply of the dividers.
    in_counts : bool
        Whether the numbers are certainly counts. Otherwise fractions that could be volts are
        rejected until a number exceeds 5.5.
    line_end : str, optional
        Text that ends a line, for a board that prints no line ends.

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
        self,
        layout: ArrayLayout,
        *,
        columns: list[int] | None = None,
        in_ohm: bool = False,
        supply_v: float | None = None,
        in_counts: bool = False,
        line_end: str | None = None,
    ) -> None:
        self._layout = layout
        self._columns = columns
        self._scale = _CountScale(layout, in_ohm=in_ohm, supply_v=supply_v, in_counts=in_counts)
        self._splitter = LineSplitter(line_end)
        self._clock = _ClockFinder(layout.pixels, above=self._scale.highest)
        self._is_synchronized = False
        #: With `columns`: numbers per line, from the first two lines that agree; and in the last.
        self._width = self._last_width = 0
        #: Whether a line contained a complete frame, or a block of lines between two blank lines.
        self._by_line = self._by_block = False
        #: Lines since the last blank line; None before the first, and after a wrong line.
        self._block: list[list[float]] | None = None
        #: Decimal points in the block.
        self._points = 0
        self._has_blank = False
        #: Fault of recent lines of a wrong form, their number, and lines for which they count.
        self._form_fault = ""
        self._suspects = self._suspect_lines = 0
        #: Complete lines since the last blank line; blank lines after an equal number of lines.
        self._lines = self._last_lines = self._equal_blocks = 0
        #: Markers of FlexiTac's frames.
        self._markers = 0
        self._fault = ""
        self.corrupt = 0

    @property
    def oversampling(self) -> int:
        """Conversions summed per reading: above 1 if the board prints mean counts."""
        return self._scale.oversampling

    @property
    def fault(self) -> str:
        """Fault of the last rejected line, with the remedy; empty if none."""
        rest = self._splitter.rest
        longest = 200 + 16 * self._layout.pixels
        if not rest or (self._splitter.has_ended and len(rest) < longest):
            return self._fault or (_RARE_LINES if self._is_synchronized else "")
        try:
            if not read_numbers(rest).values:
                return f"{_quote(rest)} {_NO_NUMBERS}"
        except ValueError as error:
            if "not text" in str(error):
                return f"{_quote(rest)} {error}"
        if self._splitter.end is not None:
            return f"{_quote(rest)} has no {self._splitter.end!r}; check line_end in the rig file"
        return (
            f"{_quote(rest)} has no line end: add Serial.println() after each frame, or name the "
            "text that ends a frame with line_end in the rig file"
        )

    def restart(self) -> None:
        """Forget an incomplete line and block, because the port was opened again."""
        self._splitter.clear()
        self._is_synchronized, self._block = False, None

    def feed(self, data: bytes) -> list[Counts]:
        """Append bytes and return the completed frames, shape (rows, cols) each."""
        try:
            lines = self._splitter.split(data)
        except ValueError:
            self.corrupt += 1
            return []
        if lines and not self._is_synchronized:
            self._is_synchronized = True
            del lines[0]  # it can be incomplete
        frames = []
        for line in lines:
            try:
                frame = self._read_line(line)
            except ValueError as error:
                self.corrupt += 1
                self._fault = f"{_quote(line)} {error}"
                if isinstance(error, FormError):
                    self._suspects += 1
                    self._suspect_lines, self._form_fault = _FORM_LINES, self._fault
            else:
                frames += [] if frame is None else [frame]
        return frames

    def _read_line(self, line: bytes) -> Counts | None:
        """Parse a line; return the completed frame, or None.

        Raises `ValueError` if the line is invalid, with the fault.
        """
        pixels = self._layout.pixels
        try:
            printed, points = read_numbers(line, wanted=None if self._columns else pixels)
        except ValueError as error:
            return self._handle_text(line, error)
        if not printed:
            if line.strip():
                self._fault = self._fault or f"{_quote(line)} {_NO_NUMBERS}"
            else:
                is_equal = self._lines == self._last_lines > 1
                self._equal_blocks = self._equal_blocks + 1 if is_equal else 0
                self._lines, self._last_lines = 0, self._lines
            return self._end_block()
        values = printed
        if self._columns is not None:
            values = self._select_columns(printed)
        elif len(printed) == pixels + 1 and not self._by_block:
            values = self._clock.remove(printed)
        if len(values) < len(printed):
            # The points of a clock in seconds do not matter.
            points -= sum(value % 1 != 0 for value in printed) - sum(v % 1 != 0 for v in values)
        if self._by_block or (len(values) != pixels and not self._by_line):
            return self._add_to_block(values, points=points, line=line)
        if len(values) != pixels:
            raise self._size_error(values, line)
        self._lines += 1
        if self._equal_blocks >= _ROW_BLOCKS:
            raise ValueError(
                f"is one of {self._last_lines} lines between blank lines, like the rows of a "
                f"frame; check layout ({self._last_lines}x{pixels}?)"
            )
        counts = self._to_counts(values, points=points)
        self._by_line = True
        return counts

    def _handle_text(self, line: bytes, error: ValueError) -> Counts | None:
        """Treat text between blocks as a blank line; raise an error otherwise."""
        self._markers += line.count(MARKER)
        if self._markers >= _MIN_MARKERS:
            raise ValueError(
                "is a binary frame of a FlexiTac board: set "
                'open = "palpate.sensor.flexitac:open_board" in the rig file'
            ) from error
        if not (self._by_line or isinstance(error, FormError)):
            frame = self._end_block()
            if self._by_block:
                return frame
        raise error

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

    def _add_to_block(self, values: list[float], *, points: int, line: bytes) -> Counts | None:
        """Add a part of a frame; return the frame if it is complete."""
        block, self._block = self._block, None
        if self._layout.pixels % len(values) or (block and len(values) != len(block[0])):
            raise self._size_error(values, line)
        if block is None:
            # The frame began before the port was open, an error, or no blank line is ever sent.
            if not self._has_blank:
                self._fault = f"the lines are rows, but {_NO_BLANK}"
            return None
        if len(block) * len(values) == self._layout.pixels:
            self._by_block = False
            raise ValueError(
                f"follows the last of {self._layout.pixels} readings, but {_NO_BLANK}; check layout"
            )
        self._block = [*block, values]
        self._points += points
        # The first block must end with a blank line, because the layout can be wrong.
        return self._join_block(self._block) if self._by_block else None

    def _end_block(self) -> Counts | None:
        """Begin a new block; return the frame of the first complete block."""
        block, self._block = self._block, []
        self._has_blank = True
        try:
            frame = self._join_block(block) if block else None
            if block and frame is None:
                raise ValueError(
                    f"ends a frame of {sum(map(len, block))} numbers, but layout "
                    f"{self._layout.name} needs {self._layout.pixels}"
                )
        finally:
            self._points = 0
        is_new, self._by_block = not self._by_block, self._by_block or frame is not None
        return frame if is_new else None

    def _join_block(self, block: list[list[float]]) -> Counts | None:
        """Return the frame of a complete block; None for an incomplete block."""
        values = [value for part in block for value in part]
        if len(values) < self._layout.pixels:
            return None
        return self._to_counts(values, points=self._points)

    def _size_error(self, values: list[float], line: bytes) -> ValueError:
        remedy = self._clock.hint or "check layout and columns"
        if b"," in line and len(values) == 2 * self._layout.pixels:
            remedy += ", and print points instead of decimal commas"
        return ValueError(
            f"has {len(values)} numbers, but layout {self._layout.name} needs "
            f"{self._layout.pixels}; {remedy}"
        )

    def _to_counts(self, values: list[float], *, points: int) -> Counts:
        counts = self._scale.convert(np.array(values), points=points)
        if self._suspect_lines:
            is_wrong = self._suspects >= _MIN_SUSPECTS
            self._suspect_lines -= 1
            if not self._suspect_lines:
                self._suspects = 0
            if is_wrong:
                raise ValueError(f"follows {self._form_fault}")
        return counts.reshape(self._layout.rows, self._layout.cols)


class _ClockFinder:
    """Finds a clock in front of or behind the pixels.

    `above`: end of the range of a reading, which a clock exceeds.
    """

    def __init__(self, pixels: int, *, above: float) -> None:
        self._pixels, self._above = pixels, above
        #: Position of the clock, 0 or -1; None if unknown.
        self._place: int | None = None
        self._last: list[float] = []
        self._increases = {0: 0, -1: 0}

    def remove(self, values: list[float]) -> list[float]:
        """Return the values without a clock; all values while no clock is certain."""
        if self._place is None:
            for place in self._increases:
                increased = bool(self._last) and values[place] > self._last[place]
                self._increases[place] = self._increases[place] + 1 if increased else 0
                if self._increases[place] >= _CLOCK_LINES and values[place] > self._above:
                    self._place = place
            self._last = values
        if self._place is None:
            return values
        return values[1:] if self._place == 0 else values[:-1]

    @property
    def hint(self) -> str:
        """Remedy if a number increases like a clock; otherwise empty."""
        for place, count in self._increases.items():
            if count >= _CLOCK_LINES // 2:
                first = 2 if place == 0 else 1
                columns = list(range(first, first + self._pixels))
                shown = columns if len(columns) <= 8 else [*columns[:2], "...", columns[-1]]
                name = "first" if place == 0 else "last"
                return f"if the {name} is a clock, set columns = [{', '.join(map(str, shown))}]"
        return ""


class _CountScale:
    """Converts printed numbers to counts of the layout's converter."""

    def __init__(
        self, layout: ArrayLayout, *, in_ohm: bool, supply_v: float | None, in_counts: bool
    ) -> None:
        self._divider = layout.divider
        self._in_ohm, self._supply_v, self._in_counts = in_ohm, supply_v, in_counts
        self._was_high = False
        #: None before the first frame.
        self._oversampling: int | None = None

    @property
    def oversampling(self) -> int:
        """Conversions summed per reading."""
        return self._oversampling or 1

    @property
    def highest(self) -> float:
        """Highest number that can be a reading."""
        if self._in_ohm:
            return math.inf
        return self._supply_v or self._divider.full_scale - 1

    def convert(self, numbers: FloatArray, *, points: int) -> Counts:
        """Return the counts of a frame that was printed with this many decimal points.

        Raises `ValueError` if a number is not a reading, with the fault.
        """
        if np.isnan(numbers).any():
            place = int(np.isnan(numbers).argmax()) + 1
            raise ValueError(
                f"has nan as reading {place}: the sketch divides by 0; print inf for an open pixel"
            )
        if (numbers < 0).any():
            raise FormError("has a negative number; print readings without subtracting anything")
        if self._in_ohm:
            return self._to_fine_counts(_OHM_REFERENCE / (_OHM_REFERENCE + numbers))
        if self._supply_v is not None:
            if numbers.max() > 1.001 * self._supply_v:
                raise ValueError(f"is above {self._supply_v:g}, the supply; check supply_v")
            return self._to_fine_counts(numbers / self._supply_v)
        if numbers.max() > self.highest:
            raise ValueError(self._explain_range(float(numbers.max())))
        if points and not self._in_counts:
            self._require_above_volts(float(numbers.max()), has_all=points >= numbers.size)
        if self._oversampling is None:
            self._oversampling = _MEAN_OF if points else 1
        counts: Counts = np.rint(numbers * self._oversampling).astype(np.int32)
        return counts

    def _to_fine_counts(self, fraction: FloatArray) -> Counts:
        divider = self._divider
        counts = np.minimum(fraction * divider.full_scale, divider.full_scale - 1)
        return np.asarray(np.rint(counts), dtype=np.int32)

    def _require_above_volts(self, peak: float, *, has_all: bool) -> None:
        """Reject fractions that can be volts, until a line is above any supply.

        A volt that has lost its decimal point is above it too, so the other numbers must have
        theirs, or the line before must have been above it as well.
        """
        is_high = peak > _HIGHEST_SUPPLY_V
        self._in_counts = is_high and (has_all or self._was_high)
        self._was_high = is_high
        if not self._in_counts:
            raise ValueError(
                'can be volts or counts: set unit = "volt" and supply_v (1 for fractions of the '
                'supply), or unit = "counts", in the rig file'
            )

    def _explain_range(self, peak: float) -> str:
        bits = self._divider.adc_bits
        fault = f"is outside 0 to {self.highest:.0f}, the range of {bits} bits; "
        digits = f"{peak:.0f}"
        if set(digits) == {"0", "1"} and digits.count("1") > 1:
            return fault + "if it is binary, print decimal numbers (Serial.print without BIN)"
        wide = [usual for usual in _USUAL_BITS if peak < 2**usual]
        if not wide:
            return fault + 'if these are resistances, set unit = "ohm"'
        volts = ', or unit = "volt" and supply_v = 3300 or 5000 for millivolts'
        return f"{fault}set adc_bits = {wide[0]}{volts if 1024 < peak <= 5000 else ''}"


def _quote(line: bytes) -> str:
    """Return the beginning of a line in quotation marks, or the length of one that is no text.

    >>> _quote(b"782 64 261"), _quote(b"\\xaa\\x55\\x00\\x81\\xf2")
    ('"782 64 261"', 'a line of 5 bytes')
    """
    text = line.strip()
    if not text:
        return "a blank line"
    excerpt = text[:40].decode("utf-8", errors="replace")
    if (
        sum(c == "\N{REPLACEMENT CHARACTER}" or not c.isprintable() for c in excerpt)
        > len(excerpt) / 4
    ):
        return f"a line of {len(text)} bytes"
    shown = "".join(c if c.isprintable() else " " for c in excerpt)
    return f'"{shown}{"..." if len(text) > 40 else ""}"'


def open_board(
    *,
    port: str,
    layout: str,
    baud: int = 115200,
    unit: Literal["counts", "ohm", "volt"] | None = None,
    supply_v: float | None = None,
    adc_bits: int = 10,
    reference_ohm: float = 4700.0,
    taxel_leg: Literal["upper", "lower"] = "upper",
    idle_lines: IdleLines = "isolated",
    fingers: int = 1,
    columns: list[int] | None = None,
    line_end: str | None = None,
    wait_s: float = OPEN_S,
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
    unit : {"counts", "ohm", "volt"}, optional
        Unit of the printed numbers: counts of the board's converter, resistances, or voltages at
        the converter. By default counts; fractions that could also be volts are refused.
    supply_v : float, optional
        The printed number at the supply voltage, for volts: 5 by default; 1 for fractions of the
        supply, 3300 for millivolts at 3.3 V.
    adc_bits, reference_ohm, taxel_leg
        Converter and divider of the counts. Volts need only the divider, ohms neither.
    idle_lines : {"isolated", "floating", "held"}
        State of the unselected lines during a reading (`ArrayLayout`).
    columns : list of int, optional
        Positions of the pixels in a line (`LineDecoder`).
    line_end : str, optional
        Text that ends a line, for a board that prints no line ends.
    wait_s : float
        Longest time from opening the port to the first frame, for a sketch that starts slowly.

    Raises
    ------
    InputError
        If the layout is unknown, or another value is invalid.
    DeviceError
        If the port can't be opened, or no frame arrives.
    """
    in_ohm = unit == "ohm"
    if in_ohm and idle_lines == "held":
        raise InputError('idle_lines = "held" needs counts: print counts instead of ohms')
    if unit != "volt" and supply_v is not None:
        raise InputError(f'supply_v = {supply_v:g} is only for volts: set unit = "volt" as well')
    if unit == "volt" and supply_v is None:
        supply_v = 5.0
    if supply_v is not None and not 0 < supply_v < math.inf:
        raise InputError(f"supply_v = {supply_v:g}: give the printed number at the supply voltage")
    if line_end is not None and (not line_end or any(c in "0123456789.+-" for c in line_end)):
        raise InputError(f"line_end = {line_end!r}: give text that is not part of a number")
    pixels = find_layout(
        layout,
        reference_ohm=_OHM_REFERENCE if in_ohm else reference_ohm,
        taxel_leg="upper" if in_ohm else taxel_leg,
        idle_lines=idle_lines,
        fingers=fingers,
        adc_bits=_FINE_BITS if unit in ("ohm", "volt") else adc_bits,
        max_lines=MAX_LINES,
    )
    if columns is not None:
        wrong = [n for n in columns if type(n) is not int or n < 1 or columns.count(n) > 1]
        if wrong or len(columns) != pixels.pixels:
            raise InputError(
                f"columns = {columns}: give {pixels.pixels} different positive integers, one "
                f"for each pixel of layout {layout}"
            )
    decoder = LineDecoder(
        pixels,
        columns=columns,
        in_ohm=in_ohm,
        supply_v=supply_v,
        in_counts=unit == "counts",
        line_end=line_end,
    )
    return OneWayArray.open_port(port, baud=baud, layout=pixels, decoder=decoder, wait_s=wait_s)
