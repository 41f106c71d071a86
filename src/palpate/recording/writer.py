"""Writes a recording so that a crash or full disk costs at most one second."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import IO, cast

from mcap.writer import Writer

from palpate.clock import Clock
from palpate.errors import DeviceTimeoutError, RecordingError, RecordingLostError
from palpate.gripper.interface import GripperState
from palpate.recording.channels import (
    METADATA_NAME,
    SCHEMAS,
    RecordedMessage,
    encode,
    encode_info,
    topic_of,
)
from palpate.recording.contents import Event, LoadCells, RecordingInfo
from palpate.sensor.array import Frame, PressureArray

#: Recorded time per chunk: what a kill can cost, with a margin of two.
CHUNK_S = 0.5
LIBRARY = "palpate"

_TIMEOUT_S = 1.0


class DirectFile:
    """A file whose writes reach the system at once, complete or with its error."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._written = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`."""
        rest = memoryview(data)
        while rest:
            rest = rest[os.write(self._descriptor, rest) :]
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the position: everything is written in order."""
        return self._written

    def flush(self) -> None:
        """Do nothing: there is no buffer."""


def register_channels(writer: Writer) -> dict[str, int]:
    """Write every schema and channel; return topic -> channel id."""
    return {
        topic: writer.register_channel(
            topic,
            "json",
            writer.register_schema(schema["title"], "jsonschema", json.dumps(schema).encode()),
        )
        for topic, schema in SCHEMAS.items()
    }


class RecordingWriter:
    """Writes one recording; also a context manager.

    Every half second of recorded time is one chunk, handed to the system whole: after `kill -9`
    the file lacks less than a second. Syncing to the disk itself (against power loss) runs in
    parallel, so that a slow card never delays a control loop.

    Parameters
    ----------
    path : path
        A new file; one that is there is not overwritten.
    info : RecordingInfo
        What the recording is of.

    Raises
    ------
    RecordingError
        If the file exists or can't be made.
    RecordingLostError
        Then or later, from any method, if it can't be written.
    """

    def __init__(self, path: str | os.PathLike[str], *, info: RecordingInfo) -> None:
        self.path = Path(path)
        self._info = info
        self._descriptor = _create(self.path)
        self._failed = False
        self._chunk_start_s: float | None = None
        self._last_s: float | None = None
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="recording-sync")
        self._sync: Future[None] | None = None
        self._writer = Writer(
            cast(IO[bytes], DirectFile(self._descriptor)), chunk_size=1 << 22, enable_data_crcs=True
        )
        try:
            self._writer.start(profile="", library=LIBRARY)
            self._writer.add_metadata(METADATA_NAME, encode_info(info))
            self._channels = register_channels(self._writer)
        except OSError as error:
            failure = self._failure(error)
            self.close()
            raise failure from error

    def add(self, message: RecordedMessage) -> None:
        """Add a frame, gripper state, event or load cell reading, in the order they happened."""
        if self._failed:
            raise RecordingLostError(
                f"{self.path}: writing failed before; nothing more is recorded"
            )
        start_s = self._chunk_start_s
        try:
            # A gripper's state may be a little younger than the frame that follows it.
            if start_s is not None and abs(message.time_s - start_s) >= CHUNK_S:
                self._finish_chunk()
            self._put(message)
        except OSError as error:
            raise self._failure(error) from error

    def add_observation(self, frame: Frame, *, gripper: GripperState) -> None:
        """Add a frame and the gripper's state at its time, as a pair for replay."""
        self.add(gripper)
        self.add(frame)

    def close(self) -> None:
        """Finish the file; calling it again does nothing."""
        if self._descriptor < 0:
            return
        try:
            if not self._failed:
                self._writer.finish()
                os.fsync(self._descriptor)
        except OSError as error:
            raise self._failure(error) from error
        finally:
            self._pool.shutdown()
            os.close(self._descriptor)
            self._descriptor = -1

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _put(self, message: RecordedMessage) -> None:
        time_ns = self._info.clock_zero_unix_ns + round(message.time_s * 1e9)
        sequence = message.sequence % 2**32 if isinstance(message, Frame) else 0
        self._writer.add_message(
            self._channels[topic_of(message)],
            log_time=max(0, time_ns),
            data=encode(message),
            publish_time=max(0, time_ns),
            sequence=sequence,
        )
        if self._chunk_start_s is None:
            self._chunk_start_s = message.time_s
        self._last_s = message.time_s

    def _finish_chunk(self) -> None:
        self._writer.flush()
        self._chunk_start_s = None
        if self._sync is None or self._sync.done():
            if self._sync is not None:
                self._sync.result()
            self._sync = self._pool.submit(os.fdatasync, self._descriptor)

    def _failure(self, error: OSError) -> RecordingLostError:
        self._failed = True
        if self._last_s is None:
            return RecordingLostError(
                f"{self.path}: {error.strerror}. Nothing is recorded; free some space first."
            )
        return RecordingLostError(
            f"{self.path}: {error.strerror}. The file lacks at most the last second before "
            f"{self._last_s:.1f} s; free some space, then run `palpate inspect --recover` on it."
        )


def _create(path: Path) -> int:
    # Exclusive: of two recorders on one new path one is refused. A device is never new.
    new = 0 if path.is_char_device() else os.O_CREAT | os.O_EXCL
    try:
        return os.open(path, os.O_WRONLY | new | os.O_CLOEXEC, 0o666)
    except FileExistsError as error:
        raise RecordingError(
            f"{path}: exists already and is not overwritten; choose another name"
        ) from error
    except OSError as error:
        raise RecordingError(f"{path}: can't be made: {error.strerror}") from error


def capture(
    array: PressureArray,
    *,
    writer: RecordingWriter,
    clock: Clock,
    duration_s: float = math.inf,
    load_cells: Callable[[], LoadCells | None] = lambda: None,
    gripper: Callable[[], GripperState | None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
    report: Callable[[str], None] = lambda _: None,
) -> int:
    """Record frames until the time is up, or it is stopped; return how many.

    A sensor that falls silent is waited for: that is reported once, and becomes an event of the
    recording, as does its return. One that stays silent until the time is up is lost.

    `duration_s`: how long; forever by default.
    `load_cells`: gives a reading of load cells if there is a new one.
    `gripper`: gives the gripper's state, if there is one; recorded with each frame.
    `stopped`: returns whether to end, between frames: a recording is never cut within a message.
    `report`: takes one line for the user.
    Raises `DeviceError` if the sensor is gone for good, or silent at the end; `RecordingLostError`
    if the file can't be written any more.
    """
    end_s = clock.now_s() + duration_s
    frames, silent = 0, False
    while (now_s := clock.now_s()) < end_s and not stopped():
        try:
            frame = array.read(timeout_s=min(_TIMEOUT_S, end_s - now_s))
        except DeviceTimeoutError as error:
            if not silent and clock.now_s() < end_s:
                silent = True
                writer.add(Event(time_s=clock.now_s(), name="silent", text=str(error)))
                report(str(error))
            continue
        if silent:
            silent = False
            writer.add(Event(time_s=frame.time_s, name="back"))
            report("frames come again")
        state = gripper()
        if state is not None:
            writer.add(state)
        writer.add(frame)
        frames += 1
        reading = load_cells()
        if reading is not None:
            writer.add(reading)
    if silent and not stopped():
        raise DeviceTimeoutError(
            f"the sensor was silent at the end: {frames} frames are recorded. Check cable and "
            "power, then run `palpate doctor`."
        )
    return frames
