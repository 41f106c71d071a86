"""Cost of recordings: writing beside a control loop, reading a million frames in bounded memory.

Run `python benchmarks/recording.py --frames 1000000`.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

from palpate.gripper.interface import GripperState
from palpate.recording import FileState, RecordingInfo, RecordingReader, RecordingWriter
from palpate.recording.reader import summarise
from palpate.sensor.array import RIGID_LAYOUT, Frame


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def write(path: Path, *, frames: int) -> None:
    counts = np.random.default_rng(0).integers(300, 310, (1000, 4, 2))
    cpu_s, slowest_s = time.process_time(), 0.0
    with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin")) as writer:
        for k in range(frames):
            frame = Frame(time_s=k / 500, sequence=k, counts=counts[k % 1000])
            started_s = time.perf_counter()
            writer.add_observation(frame, gripper=GripperState(time_s=k / 500, width_mm=50.0))
            slowest_s = max(slowest_s, time.perf_counter() - started_s)
    cpu_s = time.process_time() - cpu_s
    print(
        f"write  {frames} observations: {cpu_s / frames * 1e6:.0f} us each "
        f"({cpu_s / frames * 500 * 100:.1f} % of a core at 500/s), slowest "
        f"{slowest_s * 1e3:.1f} ms, {path.stat().st_size / frames:.0f} bytes each"
    )


def read(path: Path) -> None:
    before_mb, cpu_s = peak_mb(), time.process_time()
    with RecordingReader(path) as reader:
        summary = summarise(reader, state=FileState())
    cpu_s = time.process_time() - cpu_s
    print(
        f"read   {summary.frames} frames in {cpu_s:.1f} s of CPU, peak memory "
        f"{before_mb:.0f} -> {peak_mb():.0f} MB"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=1_000_000)
    frames = parser.parse_args().frames
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "long.mcap")
        write(path, frames=1000)
        path.unlink()
        write(path, frames=frames)
        read(path)


if __name__ == "__main__":
    main()
