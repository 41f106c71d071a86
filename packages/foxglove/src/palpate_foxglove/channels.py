"""Live channels without a counterpart in a recording: topics, JSON schemas and messages.

Frames, gripper states and events are sent in the format of a recording. A message omits unknown
quantities, because Foxglove does not accept null in a numeric field.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from typing import Any

from palpate.arrays import FloatArray
from palpate.measurement import Measurement
from palpate.recording.channels import NUMBER, message_schema
from palpate.sensor.array import ArrayLayout
from palpate.signal.relative import mean_change
from palpate.viewer import Link, pixel_names

#: Topic of the heat map, a `foxglove.RawImage`: one 32-bit float per pixel, relative change in
#: percent, NaN without a reading.
HEAT_MAP = "/heat_map"
HEAT_MAP_ENCODING = "32FC1"

_compact = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


def live_schemas(layout: ArrayLayout) -> dict[str, dict[str, Any]]:
    """Return the JSON schemas of the live channels by topic.

    `layout`: every pixel gets a field in ``/change``, with the column name of an exported table.
    """
    return {
        "/change": message_schema(
            "palpate.Change", [], mean_percent=NUMBER, **dict.fromkeys(_pixel_names(layout), NUMBER)
        ),
        "/force": message_schema(
            "palpate.Force",
            ["level", "status"],
            force_n=NUMBER,
            low_n=NUMBER,
            high_n=NUMBER,
            level=NUMBER,
            status={"type": "string"},
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
    """Encode relative changes, shape (rows, cols), as a ``/change`` message.

    >>> import numpy as np
    >>> layout = ArrayLayout(name="pad", rows=1, cols=2, finger_of_row=(0,))
    >>> encode_change(0.5, np.array([[-20.0, np.nan]]), layout=layout)
    b'{"time_s":0.5,"mean_percent":-20.0,"r0c0_percent":-20.0}'
    """
    pixels = dict(zip(_pixel_names(layout), change_percent.ravel().tolist(), strict=True))
    return _encode(time_s, {"mean_percent": float(mean_change(change_percent)), **pixels})


def encode_force(time_s: float, force_n: Measurement) -> bytes:
    """Encode a force with its interval and status as a ``/force`` message.

    >>> encode_force(0.5, Measurement(value=2.0, low=1.5, high=2.6, unit="n"))
    b'{"time_s":0.5,"force_n":2.0,"low_n":1.5,"high_n":2.6,"level":0.9,"status":"ok"}'
    """
    low_n, high_n = force_n.known_ends
    ends = {"low_n": low_n, "high_n": high_n, "level": force_n.level}
    return _encode(time_s, {"force_n": force_n.value, **ends, "status": str(force_n.status)})


def encode_link(link: Link) -> bytes:
    """Encode the state of the link as a ``/link`` message."""
    fields = asdict(link)
    return _encode(fields.pop("time_s"), fields)


def heat_map_data(change_percent: FloatArray) -> bytes:
    """Return the pixels of the heat map in row-major order, 32-bit little-endian floats."""
    return change_percent.astype("<f4").tobytes()


def _pixel_names(layout: ArrayLayout) -> list[str]:
    return [f"{pixel}_percent" for pixel in pixel_names(layout)]


def _encode(time_s: float, fields: dict[str, Any]) -> bytes:
    finite = {
        name: value
        for name, value in fields.items()
        if not (value is None or (isinstance(value, float) and not math.isfinite(value)))
    }
    return _compact({"time_s": time_s, **finite}).encode()
