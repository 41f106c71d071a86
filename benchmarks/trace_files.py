"""Files of palpate that a frame, a value of a table and a bin pass on their way.

    python benchmarks/trace_files.py
    python benchmarks/trace_files.py --files

- A frame: from the bytes of a board to the next command of a grasp.
- A value: from a logger's file of holds to its prediction.
- A bin: from the document of a grasp to the bin that the station stores with the item.

All are simulated. A file counts if one of its functions runs; the files of the twin, and what they
call, don't. `--files` lists the names.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import FrameType

import numpy as np

import palpate
from frame import DecodedArray, Stopwatch
from palpate.demo.recordings import write_recordings
from palpate.grasp.estimator import Observation
from palpate.grasp.planning import plan_grasp
from palpate.grasp.runner import run_grasp
from palpate.rig import open_rig
from palpate.rig.job import GraspJob
from palpate.sensor.array import Frame
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World
from palpate_station.dashboard.item_store import ItemStore
from palpate_station.dashboard.messages import FrameSource, Grasped
from palpate_station.sorting.conditions import Within
from palpate_station.sorting.rules import Rule, RuleBook

_PACKAGES = ("/palpate/", "/palpate_station/")
#: The simulated world, and the board that it stands for.
_WORLD = ("/palpate/twin/", "/palpate_studies/")
#: Numbers of files to aim at.
AIMS = {"a frame": 25, "a value": 20, "a bin": 15}


class FileNotes:
    """The files whose functions ran since the last `take`."""

    def __init__(self) -> None:
        self._found = set[str]()
        self._depth_in_world = 0

    def take(self) -> set[str]:
        """Return the files, and begin again."""
        found, self._found = self._found, set[str]()
        return found

    def note(self, frame: FrameType, event: str, _: object) -> None:
        """Note one call or return; for `sys.setprofile`."""
        if event not in ("call", "return"):
            return
        path = frame.f_code.co_filename
        if any(folder in path for folder in _WORLD):
            self._depth_in_world += 1 if event == "call" else -1
        elif event == "call" and not self._depth_in_world and any(p in path for p in _PACKAGES):
            self._found.add(path.split("/src/")[-1])


@contextmanager
def note_files() -> Iterator[FileNotes]:
    """Note the files whose functions run inside the block."""
    notes = FileNotes()
    sys.setprofile(notes.note)
    try:
        yield notes
    finally:
        sys.setprofile(None)


def trace_frames() -> list[set[str]]:
    """Return the files from the decoding of each frame of a grasp to that of the next."""
    calibration = calibrate_twin(seed=5, level="field", apart_from="strawberry")
    world = World(draw_object(np.random.default_rng(5), "strawberry"), seed=5, level="field")
    gripper, frames = TwinGripper(world), list[set[str]]()

    class NotedArray(DecodedArray):
        def read(self, *, timeout_s: float) -> Frame:
            frame = super().read(timeout_s=timeout_s)
            frames.append(notes.take())
            return frame

    array = NotedArray(TwinArray(world), Stopwatch())
    plan = plan_grasp(calibration, gripper=gripper)
    with note_files() as notes:
        run_grasp(plan, array=array, gripper=gripper, clock=world.clock)
    # The first entry is the preparation of the grasp.
    return frames[1:]


def trace_value(folder: Path) -> set[str]:
    """Return the files of the predictions of a logger's file."""
    write_recordings(folder)

    def predict() -> None:
        for hold in palpate.cut_holds(folder / "ohm.csv"):
            palpate.predict_settled(hold, cutoff_s=2.5)

    # The first run imports modules, which is not on the way.
    predict()
    with note_files() as notes:
        predict()
    return notes.take()


def trace_bin(folder: Path) -> set[str]:
    """Return the files from the document of a grasp to the stored bin of its item."""
    seen = list[Observation]()
    with open_rig("sim-rigid", object_name="strawberry", seed=5) as rig:
        job = GraspJob(rig)
        with job:
            job.run(subscribers=[seen.append])
        source = FrameSource(
            name=rig.name,
            layout=rig.array.layout,
            rest_ohm=rig.calibration.rest_ohm,
            gripper=rig.gripper.limits,
            origin=rig.origin,
            calibration=rig.calibration.as_text(),
        )
    by_size = Rule(bin="small", conditions=(Within("size_mm", 0, 45),), line=1)
    rules = RuleBook(rules=(by_size,), default_bin="large", most_grasps=1)
    grasped = Grasped(document=job.document(), observations=tuple(seen))
    items = ItemStore(str(folder / "items.sqlite"), rules=rules)

    def store(item_id: str) -> None:
        placement = items.place(grasped, item_id=item_id, source=source)
        document = replace(grasped.document, item_id=item_id)
        stored = items.add(document, placement=placement, calibration=source.calibration)
        assert stored.stored, stored.not_stored
        assert stored.bin is not None

    # The first item creates the store.
    store("before")
    with note_files() as notes:
        store("A1")
    return notes.take()


def main() -> None:
    """Print the number of files of each way."""
    parser = argparse.ArgumentParser(description=str(__doc__).split("\n")[0])
    parser.add_argument("--files", action="store_true", help="list the files, too")
    shows_files = parser.parse_args().files
    frames = trace_frames()
    with tempfile.TemporaryDirectory() as folder:
        ways = {
            "a frame": set[str]().union(*frames),
            "a value": trace_value(Path(folder) / "holds"),
            "a bin": trace_bin(Path(folder)),
        }
    counts = {way: float(len(files)) for way, files in ways.items()}
    counts["a frame"] = float(np.median([len(files) for files in frames]))
    for way, files in ways.items():
        more = f", {len(files)} over a whole grasp" if way == "a frame" else ""
        print(f"{way}: {counts[way]:.0f} files{more} (aim {AIMS[way]}; simulated)")
        for name in sorted(files) if shows_files else ():
            print(f"    {name}")


if __name__ == "__main__":
    main()
