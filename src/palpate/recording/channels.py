"""Channels of a recording: topics, JSON schemas, and encoding of messages.

Messages are JSON with JSON schemas, which Foxglove and the mcap tools display without a plug-in.
Arrays are flat because Foxglove does not plot nested arrays. Quantities that were not sensed are
omitted.
"""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, get_type_hints

import numpy as np

from palpate.errors import RecordingError
from palpate.files import load_dataclass
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.recording.contents import Event, LoadCells, Origin, RecordingInfo
from palpate.sensor.array import ArrayLayout, Frame

RecordedMessage = Frame | GripperState | Event | LoadCells

RECORDING_FORMAT = "1"
METADATA_NAME = "palpate"
#: Key of the metadata with the checksum of the others. MCAP itself has none for metadata.
_CHECKSUM = "crc32"
#: A sum of more conversions of 10 bits overflows the 32 bits of a count.
_MAX_OVERSAMPLING = 2**21
#: Fields of the metadata, and the types stored as plain text; other types are stored as JSON.
_INFO = get_type_hints(RecordingInfo)
_TEXTS = (str, str | None, Origin)
NUMBER = {"type": "number"}
_TIME = {"type": "number", "description": "Seconds on the recording's clock."}


def message_schema(title: str, required: list[str], **properties: dict[str, Any]) -> dict[str, Any]:
    """Return the JSON schema of a message with a time and `properties` (JSON schemas)."""
    return {
        "title": title,
        "type": "object",
        "properties": {"time_s": _TIME, **properties},
        "required": ["time_s", *required],
    }


#: Topic -> JSON schema of its messages.
SCHEMAS: dict[str, dict[str, Any]] = {
    "/frames": message_schema(
        "palpate.Frame",
        ["sequence", "counts", "oversampling"],
        sequence={"type": "integer", "description": "Gaps are lost or skipped frames."},
        counts={
            "type": "array",
            "items": {"type": "integer"},
            "description": "Raw ADC counts, row by row, summed over `oversampling` conversions.",
        },
        oversampling={"type": "integer"},
        skipped={"type": "integer", "description": "Older frames received and not used."},
    ),
    "/gripper": message_schema(
        "palpate.GripperState",
        ["moving"],
        width_mm=NUMBER,
        pressure_kpa=NUMBER,
        current_ma=NUMBER,
        moving={"type": "boolean"},
    ),
    "/events": message_schema(
        "palpate.Event", ["name", "text"], name={"type": "string"}, text={"type": "string"}
    ),
    "/load_cells": message_schema(
        "palpate.LoadCells",
        ["raw"],
        raw={"type": "array", "items": {"type": "integer"}},
        force_n={"type": "array", "items": NUMBER},
    ),
}
_TOPICS: dict[type, str] = {
    Frame: "/frames",
    GripperState: "/gripper",
    Event: "/events",
    LoadCells: "/load_cells",
}
_compact = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


def topic_of(message: RecordedMessage) -> str:
    """Return the topic of a message."""
    return _TOPICS[type(message)]


def encode(message: RecordedMessage) -> bytes:
    """Encode a message as JSON.

    Raises `ValueError` if the time is not finite.

    >>> encode(Event(time_s=1.5, name="contact"))
    b'{"time_s":1.5,"name":"contact","text":""}'
    """
    if isinstance(message, Frame):
        fields: dict[str, Any] = {
            "time_s": float(message.time_s),
            "sequence": int(message.sequence),
            "counts": message.counts.ravel().tolist(),
            "oversampling": int(message.oversampling),
            **({"skipped": message.skipped} if message.skipped else {}),
        }
    elif isinstance(message, GripperState):
        sensed = {
            name: float(getattr(message, name))
            for name in ("width_mm", "pressure_kpa", "current_ma")
            if math.isfinite(getattr(message, name))
        }
        fields = {"time_s": float(message.time_s), **sensed, "moving": bool(message.moving)}
    else:
        fields = asdict(message)
    return _compact(fields).encode()


def decode(topic: str, data: bytes, *, layout: ArrayLayout) -> RecordedMessage | None:
    """Decode a message from JSON; None for an unknown topic.

    Raises `RecordingError` if the message doesn't match its schema or the layout.
    """
    if topic not in SCHEMAS:
        return None
    try:
        fields = json.loads(data)
        if not math.isfinite(fields["time_s"]):
            raise ValueError("time is not finite")
        return _DECODERS[topic](fields, layout)
    except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
        raise RecordingError(f"a message on {topic} can't be read: {error!r}") from error


def _decode_frame(fields: dict[str, Any], layout: ArrayLayout) -> Frame:
    counts = np.array(fields["counts"])
    if counts.shape != (layout.pixels,) or counts.dtype.kind != "i":
        raise ValueError(f"expected {layout.pixels} integer counts")
    if np.any(counts != counts.astype(np.int32)):
        raise ValueError("a count is out of range")
    oversampling = _require_int64(fields["oversampling"])
    if not 1 <= oversampling <= _MAX_OVERSAMPLING:
        raise ValueError(
            f"oversampling is {oversampling}; it must be from 1 to {_MAX_OVERSAMPLING}"
        )
    return Frame(
        time_s=float(fields["time_s"]),
        sequence=_require_int64(fields["sequence"]),
        counts=counts.reshape(layout.rows, layout.cols),
        oversampling=oversampling,
        skipped=max(_require_int64(fields.get("skipped", 0)), 0),
    )


def _decode_gripper_state(fields: dict[str, Any], _: ArrayLayout) -> GripperState:
    if not isinstance(fields["moving"], bool):
        raise ValueError("moving is neither true nor false")
    return GripperState(
        time_s=float(fields["time_s"]),
        width_mm=float(fields.get("width_mm", math.nan)),
        pressure_kpa=float(fields.get("pressure_kpa", math.nan)),
        current_ma=float(fields.get("current_ma", math.nan)),
        moving=fields["moving"],
    )


def _decode_event(fields: dict[str, Any], _: ArrayLayout) -> Event:
    name, text = fields["name"], fields["text"]
    if not (isinstance(name, str) and isinstance(text, str)):
        raise ValueError("name and text must be strings")
    return Event(time_s=float(fields["time_s"]), name=name, text=text)


def _decode_load_cells(fields: dict[str, Any], _: ArrayLayout) -> LoadCells:
    return LoadCells(
        time_s=float(fields["time_s"]),
        raw=tuple(_require_int64(value) for value in fields["raw"]),
        force_n=tuple(float(value) for value in fields.get("force_n", ())),
    )


_DECODERS: dict[str, Callable[[dict[str, Any], ArrayLayout], RecordedMessage]] = {
    "/frames": _decode_frame,
    "/gripper": _decode_gripper_state,
    "/events": _decode_event,
    "/load_cells": _decode_load_cells,
}


def _require_int64(value: Any) -> int:
    """Return `value` if it is an integer of 64 bits, as integer arrays require."""
    if not isinstance(value, int) or isinstance(value, bool) or not -(2**63) <= value < 2**63:
        raise ValueError(f"{str(value)[:30]} is not an integer of 64 bits")
    return value


def encode_info(info: RecordingInfo) -> dict[str, str]:
    """Encode a recording's metadata as MCAP texts, with their checksum.

    None and empty strings are omitted.
    """
    texts = {"format": RECORDING_FORMAT}
    for name in _INFO:
        value = getattr(info, name)
        if isinstance(value, str):
            texts[name] = value
        elif value is not None:
            plain = asdict(value) if isinstance(value, ArrayLayout | GripperLimits) else value
            texts[name] = _compact(dict(plain) if isinstance(plain, Mapping) else plain)
    texts = {name: text for name, text in texts.items() if text}
    return {**texts, _CHECKSUM: _checksum(texts)}


def check_info(texts: Mapping[str, str]) -> bool | None:
    """Return whether the metadata match their checksum; None without a checksum.

    >>> texts = {"format": "1", "rig": "left"}
    >>> check_info({**texts, "crc32": "a1d63f3c"}), check_info(texts)
    (False, None)
    """
    stored = texts.get(_CHECKSUM)
    others = {name: text for name, text in texts.items() if name != _CHECKSUM}
    return None if stored is None else stored == _checksum(others)


def _checksum(texts: Mapping[str, str]) -> str:
    return f"{zlib.crc32(_compact(sorted(texts.items())).encode()):08x}"


def decode_info(texts: dict[str, str]) -> RecordingInfo:
    """Decode a recording's metadata from MCAP texts.

    Raises `RecordingError` if the format is newer, or the metadata are incomplete.
    """
    if texts.get("format") != RECORDING_FORMAT:
        raise RecordingError(
            f"its format is {texts.get('format')!r}, but this version of palpate reads "
            f"{RECORDING_FORMAT!r}; upgrade palpate"
        )
    try:
        stored = {
            name: text if _INFO[name] in _TEXTS else json.loads(text)
            for name, text in texts.items()
            if name in _INFO
        }
        info = load_dataclass(RecordingInfo, stored)
        limits = info.gripper
        if limits is not None and not (limits.lowest < limits.highest and limits.fastest > 0):
            raise ValueError("gripper: the range or the speed is not positive")
        return info
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise RecordingError(f"its metadata can't be read: {error!r}") from error
