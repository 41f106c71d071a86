"""Load of a hundred stations, extrapolated from the bytes and seconds of one frame.

    python benchmarks/fleet.py --stations 100

The frames have 12 pixels at 250/s and come from the twin (simulated, level field). Times are for
one core of this machine; only ratios are comparable between machines.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np

from palpate.force.of_calibration import force_now
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.sensor.sample import SampleReader
from palpate.sensor.wire_messages import FrameMessage
from palpate.twin.devices import TwinArray, TwinGripper
from palpate.twin.objects import draw_object
from palpate.twin.rig import calibrate_twin
from palpate.twin.world import World
from palpate_archive.adding import add_recordings
from palpate_archive.layout import open_archive
from palpate_studies.board_bytes import encode_message

RATE_HZ, LEVEL, SEED = 250.0, "field", 5
PER_DAY = RATE_HZ * 86_400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stations", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=60.0)
    options = parser.parse_args()
    obj = draw_object(np.random.default_rng(SEED), "strawberry")
    world = World(obj, seed=SEED, level=LEVEL, gripper="soft", frame_rate_hz=RATE_HZ)
    array, gripper = TwinArray(world), TwinGripper(world)
    calibration = calibrate_twin(seed=SEED, level=LEVEL, apart_from="strawberry", kind="soft")
    # Simulate all frames before the measurements.
    read = [
        (array.read(timeout_s=1.0), gripper.state()) for _ in range(int(options.seconds * RATE_HZ))
    ]
    frames = [frame for frame, _ in read]
    count = len(frames)
    message = FrameMessage(
        sequence=1, time_us=1, stream=1, oversampling=1, status=0, counts=frames[0].counts
    )
    wire = len(encode_message(message))
    with tempfile.TemporaryDirectory() as folder:
        path, root = Path(folder) / "run.mcap", Path(folder) / "archive"
        info = RecordingInfo(layout=array.layout, origin="twin", rig="fleet")
        started_s = time.perf_counter()
        with RecordingWriter(path, info=info) as writer:
            for frame, state in read:
                writer.add(state)
                writer.add(frame)
        writing_s = time.perf_counter() - started_s
        recorded = path.stat().st_size / count
        started_s = time.perf_counter()
        list(add_recordings(open_archive(root, create=True), [path]))
        adding_s = time.perf_counter() - started_s
        archived = sum(f.stat().st_size for f in root.rglob("*.parquet")) / count
    follow = force_now(calibration)
    started_s = time.perf_counter()
    reader = SampleReader(array.layout, calibration.rest.ohm)
    for frame in frames:
        sample = reader.read(frame)
        follow.step(
            sample.time_s, sample.excess, saturated=sample.has_saturated, lost=sample.has_lost
        )
    force_s = time.perf_counter() - started_s
    rows = {
        "on the wire": (wire, None),
        "recording (.mcap) with the states of the gripper": (recorded, writing_s / count),
        "archive (Parquet)": (archived, adding_s / count),
        "force with interval": (None, force_s / count),
    }
    print(f"simulated; {array.layout.pixels} pixels at {RATE_HZ:g} frames/s, {count} frames")
    for name, (size, cost_s) in rows.items():
        each = [] if size is None else [f"{size:.0f} bytes"]
        all_of = [] if size is None else [f"{options.stations * size * PER_DAY / 1e9:.0f} GB a day"]
        if cost_s is not None:
            each.append(f"{1e6 * cost_s:.0f} us")
            all_of.append(f"{options.stations * cost_s * RATE_HZ:.1f} cores")
        print(
            f"{name}: {', '.join(each)} a frame; {options.stations} stations: {', '.join(all_of)}"
        )


if __name__ == "__main__":
    main()
