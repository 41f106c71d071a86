"""Recordings and tables written and read, compared with Python's csv and with pandas."""

from __future__ import annotations

import csv
import importlib.util
import tempfile
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.gripper.interface import GripperState
from palpate.holds.table_files import read_table_file
from palpate.recording import FileState, RecordingInfo, RecordingReader, RecordingWriter
from palpate.recording.reader import load_recording, summarise_recording
from palpate.sensor.array import RIGID_LAYOUT, Frame
from palpate_studies.benchmarks.protocol import Measured, Ratio, side_by_side_s
from palpate_studies.benchmarks.running import command_of

PANDAS, RATE_HZ, WIDTH_MM = "pandas.read_csv", 500, 50.0


def measure(full: bool) -> Measured:
    """Write and read the same frames as a recording and as CSV."""
    frames = 1_000_000 if full else 20_000
    counts = np.random.default_rng(0).integers(300, 310, (frames, 4, 2))
    with tempfile.TemporaryDirectory() as folder:
        mcap, table = Path(folder, "long.mcap"), Path(folder, "long.csv")
        write_s, csv_s = side_by_side_s(
            lambda: _write(mcap, counts), lambda: _write_csv(table, counts), repeats=1
        )
        ratios = [
            _ratio("writing a recording", frames, "csv.writer", write_s, csv_s),
            _read("recording read whole", lambda: load_recording(mcap), table, frames),
            _read("CSV read", lambda: read_table_file(table), table, frames),
            _memory(lambda: _count(mcap), table, frames),
        ]
    return Measured(
        ratios=ratios,
        notes=(
            "Frames of 8 pixels with the gripper's state. A recording is compressed, each block "
            "has a checksum, and what was written before a crash is read; CSV has none of it.",
        ),
    )


command = command_of("files")


def _ratio(
    what: str, frames: int, peer: str, ours: float, theirs: float | None, unit: str = "s"
) -> Ratio:
    return Ratio(
        what=what,
        size=frames,
        of="frames",
        peer=peer,
        ours=ours,
        theirs=theirs,
        unit=unit,
        install="pip install pandas",
    )


def _read(what: str, ours: Callable[[], object], table: Path, frames: int) -> Ratio:
    acts = [ours, *_by_pandas(table)]
    taken_s = side_by_side_s(*acts, repeats=1 if frames > 100_000 else 3)
    return _ratio(what, frames, PANDAS, taken_s[0], taken_s[1] if len(acts) > 1 else None)


def _memory(ours: Callable[[], object], table: Path, frames: int) -> Ratio:
    peaks_mb = [_peak_mb(act) for act in (ours, *_by_pandas(table))]
    return _ratio(
        "memory of going through a recording",
        frames,
        PANDAS,
        peaks_mb[0],
        peaks_mb[1] if len(peaks_mb) > 1 else None,
        unit="MB",
    )


def _by_pandas(table: Path) -> list[Callable[[], object]]:
    if importlib.util.find_spec("pandas") is None:
        return []
    import pandas as pd

    return [lambda: pd.read_csv(table)]


def _peak_mb(act: Callable[[], object]) -> float:
    tracemalloc.start()
    act()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def _write(path: Path, counts: NDArray[np.int64]) -> None:
    with RecordingWriter(path, info=RecordingInfo(layout=RIGID_LAYOUT, origin="twin")) as writer:
        for k, one in enumerate(counts):
            frame = Frame(time_s=k / RATE_HZ, sequence=k, counts=one)
            state = GripperState(time_s=k / RATE_HZ, width_mm=WIDTH_MM)
            writer.add_observation(frame, gripper=state)


def _write_csv(path: Path, counts: NDArray[np.int64]) -> None:
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time_s", "sequence", "width_mm", *(f"A{n}" for n in range(8))])
        for k, one in enumerate(counts):
            writer.writerow([k / RATE_HZ, k, WIDTH_MM, *one.ravel().tolist()])


def _count(path: Path) -> None:
    with RecordingReader(path) as reader:
        summarise_recording(reader, state=FileState())
