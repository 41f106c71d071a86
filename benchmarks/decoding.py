"""Decoder throughput in bulk, on one core: at least 100 000 frames/s of 8 pixels are wanted.

Run `python benchmarks/decoding.py`. Next to it stand frames of the same pixels as lines of CSV, and
in FlexiTac's protocol read by its own package, where that is installed (`pip install flexitac`).
Both read from memory, and neither has what palpate's frames have: checksum, number, time.

Time is the process's own, so that other programs matter little; the best of several runs is what
the code can do, the median what to expect.
"""

from __future__ import annotations

import argparse
import importlib.util
import io
import sys
import time

import numpy as np

from palpate.sensor.wire import Decoder, encode_message
from palpate.sensor.wire_messages import FrameMessage

WANTED_PER_S = 100_000


def stream(frames: int, *, rows: int, cols: int) -> bytes:
    """Return the bytes of so many frames."""
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 1024, (frames, rows, cols), dtype=np.uint16)
    return b"".join(
        encode_message(
            FrameMessage(
                sequence=k,
                time_us=4000 * k,
                stream=1,
                oversampling=1,
                status=0,
                counts=counts[k],
            )
        )
        for k in range(frames)
    )


def frames_per_s(data: bytes, *, frames: int, piece: int) -> float:
    """Decode the stream in pieces; return the rate, after checking that nothing is missing."""
    decoder = Decoder()
    started_s = time.process_time()
    for start in range(0, len(data), piece):
        decoder.feed(data[start : start + piece])
    elapsed_s = time.process_time() - started_s
    if decoder.counters.frames != frames or decoder.counters.lost:
        sys.exit(f"{decoder.counters} instead of {frames} frames")
    return frames / elapsed_s


def csv_per_s(*, frames: int, rows: int, cols: int) -> float:
    """Read lines of counts as `readline` and a conversion do; return the rate."""
    rng = np.random.default_rng(0)
    counts = rng.integers(0, 1024, (frames, rows * cols))
    lines = b"".join(b",".join(b"%d" % one for one in row) + b"\r\n" for row in counts.tolist())
    port, found = io.BytesIO(lines), 0
    started_s = time.process_time()
    while line := port.readline():
        np.array(line.split(b","), dtype=int).reshape(rows, cols)
        found += 1
    elapsed_s = time.process_time() - started_s
    if found != frames:
        sys.exit(f"{found} lines instead of {frames}")
    return frames / elapsed_s


class _Port(io.BytesIO):
    """Frames in memory that come one at a reading: FlexiTac's reader drops what comes faster."""

    is_open, frame_bytes = True, 0

    def read(self, size: int | None = -1) -> bytes:
        return super().read(self.frame_bytes)


def flexitac_per_s(*, frames: int, rows: int, cols: int) -> float:
    """Read frames of FlexiTac (one byte a pixel) by its own package; return the rate."""
    from flexitac.sensor import MARKER, FlexiTacSensor

    rng = np.random.default_rng(0)
    # 0xAA can't stand in a pixel without being taken for a marker by chance.
    counts = rng.integers(0, 0xAA, (frames, rows * cols), dtype=np.uint8)
    sensor = FlexiTacSensor("memory", rows=rows, cols=cols, baseline=20.0)
    sensor._serial = _Port(b"".join(MARKER + row.tobytes() for row in counts))
    sensor._serial.frame_bytes = len(MARKER) + rows * cols
    started_s = time.process_time()
    for _ in range(frames):
        sensor.read()
    return frames / (time.process_time() - started_s)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=50_000)
    parser.add_argument("--rows", type=int, default=4)
    parser.add_argument("--cols", type=int, default=2)
    args = parser.parse_args()
    data = stream(args.frames, rows=args.rows, cols=args.cols)
    best = 0.0
    for piece in (64, 4096, 1 << 20):
        rates = [frames_per_s(data, frames=args.frames, piece=piece) for _ in range(7)]
        best = max(best, *rates)
        print(
            f"{args.rows} x {args.cols} pixels in pieces of {piece:>7} bytes: median "
            f"{np.median(rates):8.0f} frames/s, best {max(rates):8.0f}"
        )
    peers = {"lines of CSV": csv_per_s}
    if importlib.util.find_spec("flexitac"):
        peers["FlexiTac's reader"] = flexitac_per_s
    for name, peer in peers.items():
        rate = max(peer(frames=args.frames, rows=args.rows, cols=args.cols) for _ in range(3))
        print(f"{name}: best {rate:8.0f} frames/s; ours takes {rate / best:.2f} times as long")
    sys.exit(0 if best >= WANTED_PER_S else 1)


if __name__ == "__main__":
    main()
