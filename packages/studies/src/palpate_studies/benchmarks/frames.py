"""Bulk decoding of frames from memory, compared with CSV lines and FlexiTac's reader.

palpate's frames have a checksum, a sequence number and a time; those of the peers have none.
"""

from __future__ import annotations

import importlib.util
import io

import numpy as np
from numpy.typing import NDArray

from palpate.sensor.wire import Decoder
from palpate.sensor.wire_messages import FrameMessage
from palpate_studies.benchmarks.running import Measured, Ratio, command_of, side_by_side_s
from palpate_studies.board_bytes import encode_message

ROWS, COLS = 4, 2
#: Sizes of one read from a port and from a file, bytes.
PIECES = (64, 4096)
FLEXITAC = "FlexiTac's package"


def measure(full: bool) -> Measured:
    """Decode the same pixels from three formats."""
    # FlexiTac sends bytes, and a pixel of 0xAA could be mistaken for the start marker.
    counts = np.random.default_rng(0).integers(
        0, 0xAA, (50_000 if full else 10_000, ROWS, COLS), dtype=np.uint16
    )
    peers = ("readline of CSV", FLEXITAC)
    ratios = [_compare_peer(counts, piece, peer) for piece in PIECES for peer in peers]
    return ratios, ["All read from memory. The peers have no checksum, sequence number or time."]


command = command_of("frames")


def _compare_peer(counts: NDArray[np.uint16], piece: int, peer: str) -> Ratio:
    data = encode_frames(counts)
    lines = b"".join(b",".join(b"%d" % one for one in row.flat) + b"\r\n" for row in counts)
    acts = [lambda: decode(data, frames=len(counts), piece=piece)]
    if peer != FLEXITAC:
        acts.append(lambda: read_lines(lines))
    elif importlib.util.find_spec("flexitac"):
        acts.append(lambda: read_flexitac(counts))
    taken_s = side_by_side_s(*acts, repeats=5)
    return Ratio(
        what=f"decoding in pieces of {piece} bytes",
        size=len(counts),
        of="frames of 8 pixels",
        peer=peer,
        ours=taken_s[0],
        theirs=taken_s[1] if len(taken_s) > 1 else None,
        wanted=1.0 if peer == FLEXITAC else None,
        install="pip install flexitac",
    )


def encode_frames(counts: NDArray[np.uint16]) -> bytes:
    """Encode frames like the firmware."""
    return b"".join(
        encode_message(
            FrameMessage(
                sequence=k,
                time_us=4000 * k,
                stream=1,
                oversampling=1,
                status=0,
                counts=one,
            )
        )
        for k, one in enumerate(counts)
    )


def decode(data: bytes, *, frames: int, piece: int) -> None:
    """Decode a stream in pieces.

    Raises
    ------
    RuntimeError
        If a frame is missing, which makes the measured time invalid.
    """
    decoder = Decoder()
    for start in range(0, len(data), piece):
        decoder.feed(data[start : start + piece])
    if decoder.counters.frames != frames or decoder.counters.lost:
        raise RuntimeError(f"{decoder.counters} instead of {frames} frames")


def read_lines(lines: bytes) -> None:
    """Read lines of counts with `readline` and convert them to arrays."""
    port = io.BytesIO(lines)
    while line := port.readline():
        np.array(line.split(b","), dtype=int).reshape(ROWS, COLS)


class _Port(io.BytesIO):
    """Port in memory with one frame per read; FlexiTac's reader drops additional frames."""

    is_open, frame_bytes = True, 0

    def read(self, size: int | None = -1) -> bytes:
        return super().read(self.frame_bytes)


def read_flexitac(counts: NDArray[np.uint16]) -> None:
    """Read frames with FlexiTac's own package, one byte per pixel."""
    from flexitac.sensor import MARKER, FlexiTacSensor

    sensor = FlexiTacSensor("memory", rows=ROWS, cols=COLS, baseline=20.0)
    sensor._serial = _Port(b"".join(MARKER + one.astype(np.uint8).tobytes() for one in counts))
    sensor._serial.frame_bytes = len(MARKER) + ROWS * COLS
    for _ in counts:
        sensor.read()
