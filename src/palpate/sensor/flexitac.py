"""FlexiTac's boards: a matrix of 8-bit pixels, no checksum.

A rig file refers to `open_board` in its `[array]` section. The format is that of the MIT-licensed
package `flexitac` 0.3.1: a marker AA 55, then one byte per pixel, row by row. Each byte contains
the upper eight of the converter's ten bits.
"""

from __future__ import annotations

import math
import re
from collections import Counter

import numpy as np

from palpate.errors import InputError
from palpate.sensor.array import MAX_LINES, ArrayLayout
from palpate.sensor.one_way_array import OPEN_S, Counts, OneWayArray
from palpate.signal.circuit import Divider

#: Beginning of each frame.
MARKER = b"\xaa\x55"
#: Rows and columns of known boards: FlexiTac's two pads, 3D-ViTac, a development board.
_SIZES = ((12, 32), (16, 32), (16, 16), (32, 32))
#: Bytes kept to explain why no frame is found: four of the largest frames.
_RECENT_BYTES = 4 * (MAX_LINES**2 + len(MARKER))
#: Markers whose distances are compared, and pairs at the same distance that show the size.
_MOST_MARKERS, _MIN_PAIRS = 100, 3
_TEXT = re.compile(rb"[\t\r\n\x20-\x7e]{20,}")


class FlexitacDecoder:
    """Locates frames by the markers before and after each of them.

    A lost byte shifts the second marker, and the frame is rejected. A changed byte is not
    detected. Two pixels can have the values of a marker. While such a pair is repeated at the same
    place, the start of a frame is uncertain, and no frame is returned.

    `rows`, `cols`: size of the matrix that the board sends.

    >>> decoder = FlexitacDecoder(rows=12)
    >>> frame = b"\\xaa\\x55" + bytes(range(96)) * 4
    >>> [found.shape for found in decoder.feed(frame + frame[:-1] + frame + frame[:2])]
    [(12, 32), (12, 32)]
    >>> decoder.corrupt
    1
    """

    def __init__(self, *, rows: int, cols: int = 32) -> None:
        self._rows, self._cols = rows, cols
        self._size = len(MARKER) + rows * cols
        self._rest = self._recent = b""
        self._is_first = True
        self._is_synchronized = False
        self.corrupt = 0

    @property
    def fault(self) -> str:
        """Reason why the last bytes contain no frame, with the remedy; empty if they do."""
        if self._is_synchronized or not self._recent:
            return ""
        if _TEXT.fullmatch(self._recent):
            line = self._recent.splitlines()[-2 if b"\n" in self._recent else -1][:40]
            return (
                f'the board sends text ("{line.decode("ascii")}..."), like a program for '
                "diagnosis: flash the program that sends frames, or set "
                'open = "palpate.sensor.text_lines:open_board"'
            )
        if len(self._recent) < self._size + len(MARKER):
            return (
                f"these are fewer than a frame of {self._size} bytes and the next marker; if the "
                "board sends rarely, set wait_s in the rig file"
            )
        size = _find_distance(self._recent)
        if size == self._size:
            return (
                "two pixels always have the values of a marker (AA 55), and the start of a frame "
                "is uncertain; press one of these pixels"
            )
        if size is None:
            return f"no marker every {self._size} bytes; check rows, cols and baud in the rig file"
        pixels = size - len(MARKER)
        for rows, cols in _SIZES:
            if rows * cols == pixels:
                return f"markers come every {size} bytes: set rows = {rows}, cols = {cols}"
        sizes = [
            f"{rows} x {cols}"
            for rows, cols in ((pixels // self._cols, self._cols), 2 * (math.isqrt(pixels),))
            if rows * cols == pixels and 0 < max(rows, cols) <= MAX_LINES
        ]
        example = f", such as {' or '.join(dict.fromkeys(sizes))}" if sizes else ""
        return (
            f"markers come every {size} bytes: set rows and cols to a matrix of {pixels} pixels"
            f"{example}, if each pixel has one byte; otherwise this is no format of FlexiTac"
        )

    def feed(self, data: bytes) -> list[Counts]:
        """Append bytes and return the completed frames, shape (rows, cols) each."""
        if not self._is_synchronized:
            self._recent = (self._recent + data)[-_RECENT_BYTES:]
        buffer, start, size = self._rest + data, 0, self._size
        frames = []
        while len(buffer) - start >= size + len(MARKER):
            is_frame = buffer.startswith(MARKER, start) and buffer.startswith(MARKER, start + size)
            if is_frame and not (self._is_synchronized or self._is_first):
                rival = _has_rival(buffer, start, size=size)
                if rival is None:
                    break
                if rival:
                    start += size
                    continue
            self._is_first = False
            if is_frame:
                pixels = np.frombuffer(buffer, np.uint8, size - len(MARKER), start + len(MARKER))
                frames.append(pixels.reshape(self._rows, self._cols).astype(np.int32))
                start += size
                self._is_synchronized = True
                continue
            # Bytes before the first frame are the end of a frame sent earlier: no corruption.
            self.corrupt += self._is_synchronized
            self._is_synchronized = False
            start = buffer.find(MARKER, start + 1)
            if start < 0:
                start = len(buffer) - 1
        self._rest = buffer[start:]
        return frames


def _has_rival(buffer: bytes, start: int, *, size: int) -> bool | None:
    """Return whether another marker inside the frame is repeated in the next frame.

    None if more bytes are needed.
    """
    inside = buffer.find(MARKER, start + len(MARKER), start + size)
    while inside >= 0:
        if len(buffer) < inside + size + len(MARKER):
            return None
        if buffer.startswith(MARKER, inside + size):
            return True
        inside = buffer.find(MARKER, inside + 1, start + size)
    return False


def _find_distance(data: bytes) -> int | None:
    """Return the most frequent distance between markers; None if none is frequent."""
    starts = [found.start() for found in re.finditer(MARKER, data)][-_MOST_MARKERS:]
    pairs = Counter(end - start for start in starts for end in starts if end > start)
    if not pairs:
        return None
    size, count = max(pairs.items(), key=lambda pair: (pair[1], -pair[0]))
    return size if count >= _MIN_PAIRS else None


def open_board(
    *,
    port: str,
    rows: int = 12,
    cols: int = 32,
    baud: int = 2_000_000,
    reference_ohm: float = 1000.0,
    wait_s: float = OPEN_S,
) -> OneWayArray:
    """Open the array of a FlexiTac board; the array reconnects after a disconnection.

    Crosstalk is not corrected, and each reading is assigned to one pixel. Pads at rest give
    higher readings than are possible in a matrix with grounded idle columns.

    Parameters
    ----------
    port : str
        Device, e.g. ``"/dev/ttyUSB0"``.
    rows, cols : int
        Matrix that the board sends: 12 x 32 or 16 x 32; 16 x 16 for 3D-ViTac, 32 x 32 for the
        development board.
    baud : int
        Baud rate of the board's program.
    reference_ohm : float
        Resistor at the board's converter (1000 is a guess). It scales the displayed resistances
        and cancels in the force.
    wait_s : float
        Longest time from opening the port to the first frame.

    Raises
    ------
    InputError
        If the size of the matrix, the resistance or the time is invalid.
    DeviceError
        If the port can't be opened, or no frame arrives.
    """
    if not (1 <= rows <= MAX_LINES and 1 <= cols <= MAX_LINES):
        raise InputError(f"rows = {rows}, cols = {cols}: a board sends 1 to {MAX_LINES} of each")
    if not reference_ohm > 0:
        raise InputError(f"the reference resistor must be above 0 ohm, not {reference_ohm:g}")
    layout = ArrayLayout(
        name=f"flexitac-{rows}x{cols}",
        rows=rows,
        cols=cols,
        finger_of_row=(0,) * rows,
        divider=Divider(reference_ohm=reference_ohm, adc_bits=8),
    )
    decoder = FlexitacDecoder(rows=rows, cols=cols)
    return OneWayArray.open_port(port, baud=baud, layout=layout, decoder=decoder, wait_s=wait_s)
