"""`bag_to_recording BAG OUT.mcap`: convert a rosbag2 to a recording, with rosbags instead of ROS.

The description of the recording comes from the latched topic `info`; counts and their times are
exact. Images have no number, so frames are numbered from their stamps: a gap of two periods is one
lost frame.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.rosbag2 import ReaderError
from rosbags.typesys import Stores, get_typestore

from palpate.errors import PalpateError, RecordingError
from palpate.gripper.interface import GripperState
from palpate.recording import RecordingWriter
from palpate.recording.channels import decode_info
from palpate.sensor.array import ArrayLayout, Frame

#: Last parts of the names of the converted topics.
_TOPICS = ("info", "counts", "joint_states", "pressure")


def convert(bag: Path, out: Path) -> int:
    """Write a bag to a recording; return the number of frames.

    Raises
    ------
    RecordingError
        If the bag can't be read, lacks the topics of a palpate node, or the file exists.
    """
    found = _read(bag)
    if not found["info"] or not found["counts"]:
        raise RecordingError(
            f"{bag}: no topics `info` and `counts` of a palpate node; record both, e.g. "
            "`ros2 bag record --all-topics`"
        )
    texts = json.loads(found["info"][0].data)
    oversampling = int(texts.pop("oversampling"))
    info = decode_info(texts)
    zero_ns = info.clock_zero_unix_ns
    moved = [*found["joint_states"], *found["pressure"]]
    states = sorted((_state(one, zero_ns=zero_ns) for one in moved), key=lambda state: state.time_s)
    time_s = [_since_s(one, zero_ns=zero_ns) for one in found["counts"]]
    numbers = _numbers(np.array(time_s))
    with RecordingWriter(out, info=info) as writer:
        for at_s, number, message in zip(time_s, numbers, found["counts"], strict=True):
            # The state of the gripper has the stamp of its frame and is written before it.
            while states and states[0].time_s <= at_s + 1e-6:
                writer.add(states.pop(0))
            counts = _counts(message, layout=info.layout)
            writer.add(
                Frame(time_s=at_s, sequence=int(number), counts=counts, oversampling=oversampling)
            )
    return len(time_s)


def _read(bag: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {name: [] for name in _TOPICS}
    try:
        with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            wanted = [one for one in reader.connections if _name(one.topic) in found]
            for connection, _, data in reader.messages(connections=wanted):
                message = reader.deserialize(data, connection.msgtype)
                found[_name(connection.topic)].append(message)
    except (AnyReaderError, ReaderError, OSError) as error:
        raise RecordingError(f"{bag}: not a readable rosbag2: {error}") from error
    return found


def _name(topic: str) -> str:
    return topic.rpartition("/")[2]


def _since_s(message: Any, *, zero_ns: int) -> float:
    stamp = message.header.stamp
    return (stamp.sec * 1_000_000_000 + stamp.nanosec - zero_ns) / 1e9


def _state(message: Any, *, zero_ns: int) -> GripperState:
    """Return a gripper state: the opening of a joint, or a pressure with unknown motion."""
    time_s = _since_s(message, zero_ns=zero_ns)
    if hasattr(message, "fluid_pressure"):
        return GripperState(time_s=time_s, pressure_kpa=message.fluid_pressure / 1e3)
    return GripperState(
        time_s=time_s,
        width_mm=1e3 * float(message.position[0]),
        moving=bool(message.velocity[0] != 0),
    )


def _numbers(time_s: np.ndarray) -> np.ndarray:
    """Number frames from their times, in whole periods.

    Examples
    --------
    >>> _numbers(np.array([0.0, 0.1, 0.2, 0.4, 0.5])).tolist()
    [0, 1, 2, 4, 5]
    """
    steps = np.diff(time_s)
    if not steps.size:
        return np.zeros(len(time_s), dtype=int)
    periods = np.maximum(np.rint(steps / np.median(steps)), 1)
    return np.concatenate([[0], np.cumsum(periods)]).astype(int)


def _counts(message: Any, *, layout: ArrayLayout) -> np.ndarray:
    shape = (layout.rows, layout.cols)
    if (message.height, message.width) != shape or message.encoding != "16UC1":
        raise RecordingError(
            f"an image of {message.height}x{message.width} {message.encoding} does not fit the "
            f"layout's {shape[0]}x{shape[1]} 16UC1; is `counts` from another node?"
        )
    return np.frombuffer(bytes(message.data), dtype="<u2").reshape(shape).astype(np.int32)


def main() -> None:
    """Convert one bag."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("bag", type=Path, help="folder of the rosbag2")
    parser.add_argument("out", type=Path, help="new recording (.mcap)")
    options = parser.parse_args()
    try:
        frames = convert(options.bag, options.out)
    except PalpateError as error:
        sys.exit(f"bag_to_recording: {error}")
    print(f"{options.out}: {frames} frames")


if __name__ == "__main__":
    main()
