"""The live channels: topics, JSON schemas and messages that a recording does not have.

What a recording has (frames, gripper states, events) is sent as it is recorded. A quantity that is
not known is left out of its message: Foxglove reads no null in a schema of numbers.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from typing import Any

from palpate.arrays import FloatArray
from palpate.estimate.measurement import Measurement
from palpate.recording.channels import NUMBER, message_schema
from palpate.sensor.array import ArrayLayout
from palpate.signal.relative import mean_change

#: Topic of the heat map, a `foxglove.RawImage`: one 32-bit float per pixel, relative change in
#: percent, NaN where a pixel does not read.
HEAT_MAP = "/heat_map"
HEAT_MAP_ENCODING = "32FC1"

_compact = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


@dataclass(frozen=True, slots=True, kw_only=True)
class Link:
    """Where the frames come from, and how the link does."""

    time_s: float
    #: Name of the rig or port.
    source: str
    simulated: bool
    #: Frames per second of late; NaN before there are two.
    rate_hz: float
    #: Counts since the start: frames, gaps in their numbers, damaged packets.
    frames: int
    lost: int
    corrupt: int


def live_schemas(layout: ArrayLayout) -> dict[str, dict[str, Any]]:
    """Return topic -> JSON schema of the live channels.

    `layout`: each of its pixels has a field of its own in ``/change``, named as in an exported
        table.
    """
    return {
        "/change": message_schema(
            "palpate.Change", [], mean_percent=NUMBER, **dict.fromkeys(_pixel_names(layout), NUMBER)
        ),
        "/force": message_schema(
            "palpate.Force", ["level"], force_n=NUMBER, low_n=NUMBER, high_n=NUMBER, level=NUMBER
        ),
        "/link": message_schema(
            "palpate.Link",
            ["source", "simulated", "frames", "lost", "corrupt"],
            source={"type": "string"},
            simulated={"type": "boolean"},
            rate_hz=NUMBER,
            frames={"type": "integer"},
            lost={"type": "integer"},
            corrupt={"type": "integer"},
        ),
    }


def encode_change(time_s: float, change_percent: FloatArray, *, layout: ArrayLayout) -> bytes:
    """Turn relative changes, shape (rows, cols), into the JSON of ``/change``.

    >>> import numpy as np
    >>> layout = ArrayLayout(name="pad", rows=1, cols=2, finger_of_row=(0,))
    >>> encode_change(0.5, np.array([[-20.0, np.nan]]), layout=layout)
    b'{"time_s":0.5,"mean_percent":-20.0,"r0c0_percent":-20.0}'
    """
    pixels = dict(zip(_pixel_names(layout), change_percent.ravel().tolist(), strict=True))
    return _encode(time_s, {"mean_percent": float(mean_change(change_percent)), **pixels})


def encode_force(time_s: float, force_n: Measurement) -> bytes:
    """Turn a force with its interval into the JSON of ``/force``.

    >>> encode_force(0.5, Measurement(value=2.0, low=1.5, high=2.6, unit="n"))
    b'{"time_s":0.5,"force_n":2.0,"low_n":1.5,"high_n":2.6,"level":0.9}'
    """
    ends = {"low_n": force_n.low, "high_n": force_n.high, "level": force_n.level}
    return _encode(time_s, {"force_n": force_n.value, **ends})


def encode_link(link: Link) -> bytes:
    """Turn the state of the link into the JSON of ``/link``."""
    fields = asdict(link)
    return _encode(fields.pop("time_s"), fields)


def heat_map_data(change_percent: FloatArray) -> bytes:
    """Return the pixels of the heat map, row by row."""
    return change_percent.astype("<f4").tobytes()


def _pixel_names(layout: ArrayLayout) -> list[str]:
    return [f"r{row}c{col}_percent" for row in range(layout.rows) for col in range(layout.cols)]


def _encode(time_s: float, fields: dict[str, Any]) -> bytes:
    known = {
        name: value
        for name, value in fields.items()
        if not (isinstance(value, float) and not math.isfinite(value))
    }
    return _compact({"time_s": time_s, **known}).encode()
