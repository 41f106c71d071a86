"""FlexiTac's board: 12 x 32 or 16 x 32 pixels, 8 bits, no checksum.

`open_board` is what a rig file names for its `[array]`. The format is that of the MIT-licensed
package `flexitac` 0.3.1: a marker AA 55, then a byte a pixel, row by row, the ten bits of the
converter without the lower two.
"""

from __future__ import annotations

import numpy as np

from palpate.errors import InputError
from palpate.sensor.array import ArrayLayout
from palpate.sensor.one_way_array import Counts, OneWayArray
from palpate.signal.circuit import Divider

_MARKER = b"\xaa\x55"
#: Its columns, and the rows that its board reads through one multiplexer.
_COLS, _MOST_ROWS = 32, 16


class FlexitacDecoder:
    """Finds frames by a marker at both their ends.

    Lost bytes shift the second marker, so that the frame is rejected; a changed byte is not
    detected.

    `rows`: that the board's program sends.

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
        self._in_step = False
        self.corrupt = 0
        self.fault = ""

    def feed(self, data: bytes) -> list[Counts]:
        """Take bytes; return the frames that they complete, shape (rows, 32) each."""
        buffer, at, size = self._rest + data, 0, self._size
        frames = []
        while len(buffer) - at >= size + len(_MARKER):
            if buffer.startswith(_MARKER, at) and buffer.startswith(_MARKER, at + size):
                pixels = np.frombuffer(buffer, np.uint8, size - len(_MARKER), at + len(_MARKER))
                frames.append(pixels.reshape(self._rows, _COLS).astype(np.int32))
                at += size
                self._in_step = True
                continue
            # What came before the first frame is the end of another.
            self.corrupt += self._in_step
            self._in_step = False
            self.fault = f"no marker every {size} bytes; check rows and baud in the rig file"
            at = buffer.find(_MARKER, at + 1)
            if at < 0:
                at = len(buffer) - 1
        self._rest = buffer[at:]
        return frames


def open_board(
    *, port: str, rows: int = 12, baud: int = 2_000_000, reference_ohm: float = 1000.0
) -> OneWayArray:
    """Open the array of a FlexiTac board; it reconnects after an unplug.

    Readings are taken as those of single pixels: pads at rest read more than a matrix whose idle
    columns are at ground could, so that crosstalk is not solved out.

    Parameters
    ----------
    port : str
        Device, e.g. ``"/dev/ttyUSB0"``.
    rows : int
        That its program sends: 12, or 16.
    baud : int
        Speed that its program sets.
    reference_ohm : float
        The resistor at its converter (1000 is a guess). It scales the ohms that are shown, and
        cancels in the force.

    Raises
    ------
    InputError
        If the number of rows is impossible, or the resistance is invalid.
    DeviceError
        If the port can't be opened, or no frame comes.
    """
    if not 1 <= rows <= _MOST_ROWS:
        raise InputError(f"rows = {rows}: a FlexiTac board sends 1 to {_MOST_ROWS}")
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
    return OneWayArray.on_port(port, baud=baud, layout=layout, decoder=decoder)
