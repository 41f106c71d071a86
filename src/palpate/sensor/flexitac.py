"""FlexiTac's board: 12 x 32 or 16 x 32 pixels, 8 bits, no checksum.

A rig file refers to `open_board` in its `[array]` section. The format is that of the MIT-licensed
package `flexitac` 0.3.1: a marker AA 55, then one byte per pixel, row by row. Each byte contains
the upper eight of the converter's ten bits.
"""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.one_way_array import Counts, OneWayArray
from palpate.signal.circuit import Divider

_MARKER = b"\xaa\x55"
#: Number of columns, and maximum number of rows of the board's multiplexer.
_COLS, _MAX_ROWS = 32, 16


class FlexitacDecoder:
    """Locates frames by the markers before and after each of them.

    A lost byte shifts the second marker, and the frame is rejected. A changed byte is not
    detected.

    `rows`: number of rows that the board sends.

    >>> decoder = FlexitacDecoder(rows=12)
    >>> frame = b"\\xaa\\x55" + bytes(range(96)) * 4
    >>> [found.shape for found in decoder.feed(frame + frame[:-1] + frame + frame[:2])]
    [(12, 32), (12, 32)]
    >>> decoder.corrupt
    1
    """

    def __init__(self, *, rows: int) -> None:
        self._rows = rows
        self._size = len(_MARKER) + rows * _COLS
        self._rest = b""
        self._is_synchronized = False
        self.corrupt = 0
        self.fault = ""

    def feed(self, data: bytes) -> list[Counts]:
        """Append bytes and return the completed frames, shape (rows, 32) each."""
        buffer, start, size = self._rest + data, 0, self._size
        frames = []
        while len(buffer) - start >= size + len(_MARKER):
            if buffer.startswith(_MARKER, start) and buffer.startswith(_MARKER, start + size):
                pixels = np.frombuffer(buffer, np.uint8, size - len(_MARKER), start + len(_MARKER))
                frames.append(pixels.reshape(self._rows, _COLS).astype(np.int32))
                start += size
                self._is_synchronized = True
                continue
            # Bytes before the first frame are the end of a frame sent earlier: no corruption.
            self.corrupt += self._is_synchronized
            self._is_synchronized = False
            self.fault = f"no marker every {size} bytes; check rows and baud in the rig file"
            start = buffer.find(_MARKER, start + 1)
            if start < 0:
                start = len(buffer) - 1
        self._rest = buffer[start:]
        return frames


def open_board(
    *, port: str, rows: int = 12, baud: int = 2_000_000, reference_ohm: float = 1000.0
) -> OneWayArray:
    """Open the array of a FlexiTac board; the array reconnects after a disconnection.

    Crosstalk is not corrected, and each reading is assigned to one pixel. Pads at rest give
    higher readings than are possible in a matrix with grounded idle columns.

    Parameters
    ----------
    port : str
        Device, e.g. ``"/dev/ttyUSB0"``.
    rows : int
        Number of rows that the board sends: 12 or 16.
    baud : int
        Baud rate of the board's program.
    reference_ohm : float
        Resistor at the board's converter (1000 is a guess). It scales the displayed resistances
        and cancels in the force.

    Raises
    ------
    InputError
        If the number of rows or the resistance is invalid.
    DeviceError
        If the port can't be opened, or no frame arrives.
    """
    if not 1 <= rows <= _MAX_ROWS:
        raise InputError(f"rows = {rows}: a FlexiTac board sends 1 to {_MAX_ROWS}")
    if not reference_ohm > 0:
        raise InputError(f"the reference resistor must be above 0 ohm, not {reference_ohm:g}")
    layout = ArrayLayout(
        name=f"flexitac-{rows}x{_COLS}",
        rows=rows,
        cols=_COLS,
        finger_of_row=(0,) * rows,
        divider=Divider(reference_ohm=reference_ohm, adc_bits=8),
    )
    decoder = FlexitacDecoder(rows=rows)
    return OneWayArray.open_port(port, baud=baud, layout=layout, decoder=decoder)
