"""Writer of recordings: a crash or full disk loses at most one second."""

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
from palpate.errors import DISK_FAILURES, DeviceTimeoutError, RecordingError, RecordingLostError
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
from palpate.stop_signals import finish_first

#: Recorded time per chunk: half of the one second that a killed process may lose.
CHUNK_S = 0.5
LIBRARY = "palpate"

_TIMEOUT_S = 1.0


class DirectFile:
    """An unbuffered file; a write passes all data to the system or raises its error."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._written = 0

    def write(self, data: bytes) -> int:
        """Write all of `data`."""
        remaining = memoryview(data)
        while remaining:
            remaining = remaining[os.write(self._descriptor, remaining) :]
        self._written += len(data)
        return len(data)

    def tell(self) -> int:
        """Return the number of bytes written."""
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
    """Writer of one recording; also a context manager.

    Every half second of recorded time is handed to the operating system as one complete chunk, so
    `kill -9` loses less than a second. Syncing to disk, which protects against power loss, runs in
    parallel: a slow card never delays a control loop.

    Parameters
    ----------
    path : path
        A new file; an existing file is not overwritten.
    info : RecordingInfo
        Description of the recorded rig.

    Raises
    ------
    RecordingError
        If the file exists or can't be created.
    RecordingLostError
        From the constructor or any method if writing fails.
    """

    def __init__(self, path: str | os.PathLike[str], *, info: RecordingInfo) -> None:
        self.path = Path(path)
        self._info = info
        self._descriptor = _create_file(self.path)
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
            failure = self._record_failure(error)
            self.close()
            # An empty file would block the same name.
            if not self.path.is_char_device():
                self.path.unlink(missing_ok=True)
            raise failure from error

    def add(self, message: RecordedMessage) -> None:
        """Add a frame, gripper state, event or load cell reading, in chronological order."""
        if self._failed:
            raise RecordingLostError(
                f"{self.path}: recording stopped after an earlier write error; start a new one"
            )
        start_s = self._chunk_start_s
        try:
            # A gripper state may be slightly later than the frame after it, hence `abs`.
            with finish_first():
                if start_s is not None and abs(message.time_s - start_s) >= CHUNK_S:
                    self._finish_chunk()
                self._write_message(message)
        except OSError as error:
            raise self._record_failure(error) from error

    def add_observation(self, frame: Frame, *, gripper: GripperState) -> None:
        """Add a frame and the gripper's state at its time, as a pair for replay."""
        self.add(gripper)
        self.add(frame)

    def close(self) -> None:
        """Complete and close the file; further calls have no effect.

        Raises `RecordingLostError` if the file can't be completed, or is no longer at its path.
        """
        if self._descriptor < 0:
            return
        with finish_first():
            try:
                if not self._failed:
                    self._writer.finish()
                    # The system reports a failed sync only once, here or to the parallel one.
                    os.fsync(self._descriptor)
                    if self._sync is not None:
                        self._sync.result()
                    self._check_place()
            except OSError as error:
                raise self._record_failure(error) from error
            finally:
                self._pool.shutdown()
                os.close(self._descriptor)
                self._descriptor = -1

    def _check_place(self) -> None:
        """Raise an error if the file was deleted, moved or replaced during the recording."""
        try:
            is_same = os.path.samestat(os.fstat(self._descriptor), os.stat(self.path))
        except OSError:
            is_same = False
        if not is_same:
            self._failed = True
            raise RecordingLostError(
                f"{self.path}: the file was deleted, moved or replaced during the recording; "
                "the recording is not there. Record again"
            )

    def __enter__(self) -> RecordingWriter:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def _write_message(self, message: RecordedMessage) -> None:
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
            self._sync = self._pool.submit(_sync_data, self._descriptor)

    def _record_failure(self, error: OSError) -> RecordingLostError:
        self._failed = True
        if self._last_s is None:
            return RecordingLostError(
                f"{self.path}: {error.strerror}. Nothing was recorded; free some disk space first."
            )
        return RecordingLostError(
            f"{self.path}: {error.strerror}. At most the last second before {self._last_s:.1f} s "
            "is lost; free some disk space, then run `palpate inspect --recover` on the file."
        )


def _sync_data(descriptor: int) -> None:
    """Write a file's data to the disk; macOS and Windows have no `fdatasync`."""
    getattr(os, "fdatasync", os.fsync)(descriptor)


def _create_file(path: Path) -> int:
    try:
        # O_EXCL refuses the second of two recorders with the same path. A device always exists.
        new = 0 if path.is_char_device() else os.O_CREAT | os.O_EXCL
        # Without O_BINARY, Windows replaces line ends.
        return os.open(path, os.O_WRONLY | new | getattr(os, "O_BINARY", 0), 0o666)
    except FileExistsError as error:
        raise RecordingError(
            f"{path}: already exists and is not overwritten; choose another name"
        ) from error
    except OSError as error:
        kind = RecordingLostError if error.errno in DISK_FAILURES else RecordingError
        raise kind(f"{path}: can't be created: {error.strerror}") from error
    except ValueError as error:  # a name with NUL
        raise RecordingError(f"{str(path)!r}: can't be created: {error}") from error


def record_frames(
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
    """Record frames for a duration or until stopped; return the number of frames.

    If the sensor stops sending, recording waits for it. The interruption and its end are reported
    and stored as events. A sensor that is still silent at the end of the duration is an error.

    `duration_s`: unlimited by default.
    `load_cells`: returns a new reading of the load cells, or None.
    `gripper`: returns the gripper's state, or None without a gripper; recorded with each frame.
    `stopped`: returns whether to end; called between frames.
    `report`: receives one line for the user.
    Raises `DeviceError` if the sensor is lost, or silent at the end; `RecordingLostError` if
    writing fails.
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
            report("frames are arriving again")
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
            f"the sensor was silent at the end: {frames} frames were recorded. Check cable and "
            "power, then run `palpate doctor`."
        )
    return frames
