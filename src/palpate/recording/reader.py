"""Reader of complete or truncated recordings in bounded memory, and counts of their contents."""

from __future__ import annotations

import os
import warnings
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from mcap.records import Channel, Message, Metadata
from numpy.typing import NDArray

from palpate.errors import DamageWarning, RecordingError
from palpate.gripper.interface import GripperState
from palpate.recording.blocks import FileState, read_blocks
from palpate.recording.channels import (
    METADATA_NAME,
    RecordedMessage,
    check_info,
    decode,
    decode_info,
)
from palpate.recording.contents import Event, GripperTrack, LoadCells, Recording, RecordingInfo
from palpate.sensor.array import Frame

_Item = TypeVar("_Item", bound=np.generic)

__all__ = ["FileState", "RecordingReader", "load_recording"]


class RecordingReader:
    """Reader of one recording, which checks the whole file first; also a context manager.

    Parameters
    ----------
    path : path
        An `.mcap` file written by palpate, complete or truncated.

    Attributes
    ----------
    info : RecordingInfo
        Description of the recorded rig.
    state : FileState
        Completeness and damage of the file.

    Raises
    ------
    RecordingError
        If the file can't be opened, isn't a palpate recording, or its description is damaged: a
        wrong digit of the calibration would give a wrong answer.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        try:
            self._stream = self.path.open("rb")
        except OSError as error:
            raise RecordingError(f"{self.path}: can't be opened: {error.strerror}") from error
        except ValueError as error:  # a name with NUL
            raise RecordingError(f"{str(self.path)!r}: can't be opened: {error}") from error
        self.state = FileState()
        try:
            self.info = self._read_info()
        except RecordingError as error:
            self._stream.close()
            raise RecordingError(f"{self.path}: {error}") from error

    def messages(self) -> Iterator[RecordedMessage]:
        """Yield frames, gripper states, events and load cell readings in recorded order.

        A file that is incomplete, damaged or can't be checked is named first, in a
        `DamageWarning`.

        Raises
        ------
        RecordingError
            If a message with a valid checksum doesn't match its schema.
        """
        if condition := self.state.describe():
            warnings.warn(f"{self.path}: {condition}", DamageWarning, stacklevel=1)
        yield from self.readable_messages()

    def readable_messages(self) -> Iterator[RecordedMessage]:
        """Yield the messages without a warning, for a caller that reports `state` itself."""
        topics: dict[int, str] = {}
        for block in read_blocks(self._stream, state=FileState()):
            for record in block:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    message = self._decode(record, topic=topics.get(record.channel_id, ""))
                    if message is not None:
                        yield message

    def close(self) -> None:
        """Close the file; further calls have no effect."""
        self._stream.close()

    def __enter__(self) -> RecordingReader:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _decode(self, record: Message, *, topic: str) -> RecordedMessage | None:
        try:
            return decode(topic, record.data, layout=self.info.layout)
        except RecordingError as error:
            raise RecordingError(f"{self.path}: {error}") from error

    def _read_info(self) -> RecordingInfo:
        """Check every record of the file; return the description."""
        texts: dict[str, str] | None = None
        for block in read_blocks(self._stream, state=self.state):
            for record in block:
                if isinstance(record, Metadata) and record.name == METADATA_NAME and texts is None:
                    texts = record.metadata
        if texts is None:
            raise RecordingError(
                "an MCAP file, but not a palpate recording (its metadata are missing or damaged)"
            )
        self.state.description_matches = check_info(texts)
        if self.state.is_description_damaged:
            raise RecordingError(
                f"damaged: {self.state.describe()}; nothing can be computed from it. Restore a "
                "copy; MCAP tools still read its frames"
            )
        return decode_info(texts)


def load_recording(path: str | os.PathLike[str]) -> Recording:
    """Read a recording into arrays.

    A frame of 8 pixels needs 52 bytes, and a gripper state 33.

    Parameters
    ----------
    path : path
        An `.mcap` file written by palpate, complete or truncated.

    Returns
    -------
    Recording
        All readable messages.

    Raises
    ------
    RecordingError
        If the file can't be opened or isn't a palpate recording.
    """
    time_s, sequence, counts, oversampling = array("d"), array("q"), array("i"), array("i")
    gripper: dict[str, array[float]] = {
        name: array("d") for name in ("time_s", "width_mm", "pressure_kpa", "current_ma")
    }
    moving = bytearray()
    events: list[Event] = []
    load_cells: list[LoadCells] = []
    with RecordingReader(path) as reader:
        for message in reader.messages():
            if isinstance(message, Frame):
                time_s.append(message.time_s)
                sequence.append(message.sequence)
                counts.frombytes(message.counts.tobytes())
                oversampling.append(message.oversampling)
            elif isinstance(message, GripperState):
                for name, column in gripper.items():
                    column.append(getattr(message, name))
                moving.append(message.moving)
            elif isinstance(message, Event):
                events.append(message)
            else:
                load_cells.append(message)
        layout = reader.info.layout
    return Recording(
        info=reader.info,
        time_s=_freeze(np.array(time_s)),
        sequence=_freeze(np.array(sequence, dtype=np.int64)),
        counts=_freeze(np.array(counts, dtype=np.int32).reshape(-1, layout.rows, layout.cols)),
        oversampling=_freeze(np.array(oversampling, dtype=np.int32)),
        gripper=GripperTrack(
            **{name: _freeze(np.array(column)) for name, column in gripper.items()},
            moving=_freeze(np.array(moving, dtype=np.bool_)),
        ),
        events=tuple(events),
        load_cells=tuple(load_cells),
    )


def _freeze(column: NDArray[_Item]) -> NDArray[_Item]:
    column.flags.writeable = False
    return column


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingSummary:
    """Counts of the messages in a recording.

    `frames_skipped` counts frames that arrived and were not used (`Frame.skipped`), and
    `frames_lost` the other missing frame numbers; `duration_s` is from the first to the last
    frame; `rate_hz` is None with fewer than two frames.
    """

    frames: int
    frames_skipped: int
    frames_lost: int
    duration_s: float
    rate_hz: float | None
    gripper_states: int
    events: int
    load_cell_readings: int


def summarise_recording(reader: RecordingReader) -> RecordingSummary:
    """Count the readable messages of a recording."""
    counts = {Frame: 0, GripperState: 0, Event: 0, LoadCells: 0}
    first: Frame | None = None
    last: Frame | None = None
    lost = skipped = 0
    for message in reader.readable_messages():
        counts[type(message)] += 1
        if isinstance(message, Frame):
            if last is not None:
                gap = message.sequence - last.sequence - 1
                lost += max(0, gap - message.skipped)
            skipped += message.skipped
            first, last = first or message, message
    duration_s = 0.0 if first is None or last is None else last.time_s - first.time_s
    return RecordingSummary(
        frames=counts[Frame],
        frames_skipped=skipped,
        frames_lost=lost,
        duration_s=duration_s,
        rate_hz=(counts[Frame] - 1) / duration_s if duration_s > 0 else None,
        gripper_states=counts[GripperState],
        events=counts[Event],
        load_cell_readings=counts[LoadCells],
    )
