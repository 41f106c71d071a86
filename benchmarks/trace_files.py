"""Files that a frame, a value of a table and a bin pass on their way.

    python benchmarks/trace_files.py

A frame from the bytes of a board to the next command, a value of a CSV file to its prediction, and
the result of a grasp to the stored bin of its item (all simulated). A file counts if one of its
functions runs.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

from benchmarks.frame import trace_frame

import palpate
from palpate.demo.recordings import write_recordings

_SOURCES = ("/palpate/", "/palpate_station/")


@contextmanager
def note_files() -> Iterator[set[str]]:
    """Collect the files whose functions run inside the block."""
    found = set[str]()

    def note(frame: FrameType, event: str, _: object) -> None:
        name = frame.f_code.co_filename
        if event == "call" and any(source in name for source in _SOURCES):
            found.add(name.split("/src/")[-1])

    sys.setprofile(note)
    try:
        yield found
    finally:
        sys.setprofile(None)


def trace_value(folder: Path) -> set[str]:
    """Predict the holds of a logger's file; what is imported on first use is imported before."""
    write_recordings(folder)

    def predict() -> None:
        for hold in palpate.cut_holds(folder / "ohm.csv"):
            palpate.predict_settled(hold, cutoff_s=2.5)

    predict()
    with note_files() as found:
        predict()
    return found


def show(what: str, files: set[str]) -> None:
    """Print the number and the names."""
    print(f"{what}: {len(files)} files")
    for name in sorted(files):
        print(f"    {name}")


def main() -> None:
    """Print the files of each way."""
    traces: dict[str, Callable[[Path], set[str]]] = {"a value of a table": trace_value}
    median, of_all = trace_frame()
    print(f"a frame: {median:.0f} files in the median, over a whole grasp:")
    show("    ", of_all)
    for what, trace in traces.items():
        with tempfile.TemporaryDirectory() as folder:
            show(what, trace(Path(folder)))


if __name__ == "__main__":
    main()
