"""Recordings: writing, reading, truncation, full disks and recovery."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections import deque
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import NonSeekingReader, make_reader
from mcap.records import Chunk, DataEnd
from mcap.stream_reader import StreamReader
from mcap.writer import Writer
from tests.full_disk import file_size_limit
from tests.recordings import INFO, MESSAGES, write_recording

from palpate.errors import DamageWarning, RecordingError
from palpate.gripper.interface import GripperLimits, GripperState
from palpate.recording import (
    FileState,
    RecordingInfo,
    RecordingReader,
    RecordingWriter,
    load_recording,
    recover,
)
from palpate.recording.channels import (
    METADATA_NAME,
    RecordedMessage,
    decode,
    decode_info,
    encode,
    encode_info,
    topic_of,
)
from palpate.recording.writer import register_channels
from palpate.sensor.array import RIGID_LAYOUT, Frame

WRITE_UNTIL_KILLED = """
import os, sys
import numpy as np
from palpate.recording import RecordingInfo, RecordingWriter
from palpate.sensor.array import RIGID_LAYOUT, Frame

counts = np.arange(8).reshape(4, 2)
for path in sys.argv[1:]:
    child = os.fork()
    if child == 0:
        os.write(1, f"pid {os.getpid()}\\n".encode())
        info = RecordingInfo(layout=RIGID_LAYOUT, origin="twin")
        with RecordingWriter(path, info=info) as writer:
            k = 0
            while True:
                writer.add(Frame(time_s=k / 500, sequence=k, counts=counts + k % 500))
                # Long lines: a pipe buffers 64 kB, and the writer must not run far ahead.
                os.write(1, f"{k / 500:<1000}\\n".encode())
                k += 1
    os.waitpid(child, 0)
    os.write(1, b"dead\\n")
"""


def is_same(first: RecordedMessage, second: RecordedMessage) -> bool:
    """Compare two messages exactly, arrays and NaN included."""
    return type(first) is type(second) and repr(first) == repr(second)


def read_all(path: Path) -> tuple[list[RecordedMessage], FileState]:
    with RecordingReader(path) as reader:
        return list(reader.readable_messages()), reader.state


def count_with_strict_readers(path: Path) -> int:
    """Return the number of messages in the strict readers of the mcap package."""
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary.statistics is not None
    with path.open("rb") as stream:
        seeking = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
    with path.open("rb") as stream:
        linear = sum(1 for _ in NonSeekingReader(stream, validate_crcs=True).iter_messages())
    assert seeking == linear == summary.statistics.message_count
    return linear


def test_recording_roundtrip_preserves_all_messages(recorded: Path) -> None:
    read, state = read_all(recorded)
    assert state.is_intact
    assert len(read) == len(MESSAGES) == count_with_strict_readers(recorded)
    assert all(map(is_same, read, MESSAGES))
    with RecordingReader(recorded) as reader:
        assert reader.info == INFO


def test_load_recording_arrays_match_messages(recorded: Path) -> None:
    recording = load_recording(recorded)
    frames = [message for message in MESSAGES if isinstance(message, Frame)]
    states = [message for message in MESSAGES if isinstance(message, GripperState)]
    assert recording.counts.shape == (200, 4, 2)
    assert np.array_equal(recording.counts, [frame.counts for frame in frames])
    assert recording.time_s.tolist() == [frame.time_s for frame in frames]
    assert recording.sequence.tolist() == [frame.sequence for frame in frames]
    assert recording.gripper.moving.tolist() == [state.moving for state in states]
    assert np.isnan(recording.gripper.pressure_kpa).all()
    assert recording.events[0].text == "ripe — by eye"
    assert recording.load_cells[0].raw == (-12, 8_388_607)
    with pytest.raises(ValueError, match="read-only"):
        recording.counts[0, 0, 0] = 1


def test_damaged_chunk_loses_only_its_own_messages(recorded: Path) -> None:
    with recorded.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    damaged = bytearray(recorded.read_bytes())
    damaged[summary.chunk_indexes[3].chunk_start_offset + 200] ^= 0x10
    recorded.write_bytes(damaged)
    read, state = read_all(recorded)
    assert (state.complete, state.damaged_chunks) == (True, 1)
    assert len(MESSAGES) - 60 <= len(read) < len(MESSAGES)
    recover(recorded, recorded)
    assert count_with_strict_readers(recorded) == len(read)


@pytest.mark.parametrize("fraction", [0.5, 1.0])
def test_changed_digit_of_the_calibration_is_refused(
    recorded: Path, tmp_path: Path, fraction: float
) -> None:
    content = recorded.read_bytes()
    changed = content.replace(b"resistance_ohm = 1", b"resistance_ohm = 7")
    assert len(changed) == len(content)
    assert changed != content
    recorded.write_bytes(changed[: int(fraction * len(changed))])
    for read in (RecordingReader, load_recording, lambda path: recover(path, tmp_path / "new")):
        with pytest.raises(RecordingError, match=r"run\.mcap: damaged: .*calibration") as caught:
            read(recorded)
        assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_recording_without_any_checksum_is_read_with_a_warning(tmp_path: Path) -> None:
    texts = encode_info(INFO)
    del texts["crc32"]
    path = tmp_path / "old.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, enable_crcs=False)
        writer.start()
        writer.add_metadata(METADATA_NAME, texts)
        channels = register_channels(writer)
        for message in MESSAGES:
            writer.add_message(
                channels[topic_of(message)], log_time=0, data=encode(message), publish_time=0
            )
        writer.finish()
    with pytest.warns(DamageWarning, match="can't be checked: no checksum"):
        recording = load_recording(path)
    assert len(recording.time_s) == 200
    assert recording.info == INFO


@pytest.mark.slow
def test_killed_writer_loses_less_than_one_second(tmp_path: Path) -> None:
    rng = np.random.default_rng(20)
    paths = [tmp_path / f"{k}.mcap" for k in range(8)]
    with subprocess.Popen(
        [sys.executable, "-c", WRITE_UNTIL_KILLED, *map(str, paths)],
        stdout=subprocess.PIPE,
        text=True,
    ) as writers:
        assert writers.stdout is not None
        for path in paths:
            child = int(writers.stdout.readline().split()[1])
            for _ in range(int(rng.integers(100, 800))):
                last = writers.stdout.readline()
            os.kill(child, signal.SIGKILL)
            while (line := writers.stdout.readline()) != "dead\n":
                last = line if line.endswith("\n") else last
            read, state = read_all(path)
            assert not state.complete
            end_s = read[-1].time_s if read else 0.0
            assert end_s > float(last) - 1.0
            assert [message.time_s for message in read] == [k / 500 for k in range(len(read))]
            recover(path, path)
            assert count_with_strict_readers(path) == len(read)


def test_writer_full_disk_raises_one_line_and_file_is_recoverable(tmp_path: Path) -> None:
    path = tmp_path / "full.mcap"
    counts = np.random.default_rng(0).integers(0, 1024, (5000, 4, 2))
    frames = [Frame(time_s=k / 500, sequence=k, counts=count) for k, count in enumerate(counts)]
    writer = RecordingWriter(path, info=INFO)
    with (
        file_size_limit(60_000),
        pytest.raises(RecordingError, match=r"full\.mcap: File too large.*recover") as failure,
    ):
        deque(map(writer.add, frames), maxlen=0)
    with pytest.raises(RecordingError, match="after an earlier write error"):
        writer.add(frames[-1])
    writer.close()
    writer.close()
    read, state = read_all(path)
    assert not state.complete
    assert len(read) / 500 > float(str(failure.value).split("before ")[1].split()[0]) - 1.0
    recover(path, path)
    assert count_with_strict_readers(path) == len(read)


@pytest.mark.parametrize("oversampling", [0, 2**22, True, 1.5, None])
def test_decode_invalid_oversampling_is_refused(oversampling: object) -> None:
    frame = encode(Frame(time_s=0.0, sequence=0, counts=np.zeros((4, 2)), oversampling=64))
    assert decode("/frames", frame, layout=RIGID_LAYOUT) is not None
    damaged = json.dumps(json.loads(frame) | {"oversampling": oversampling}).encode()
    with pytest.raises(RecordingError, match=r"oversampling|integer of 64 bits"):
        decode("/frames", damaged, layout=RIGID_LAYOUT)


@pytest.mark.parametrize("change", [{"fastest": 0.0}, {"highest": 5.0}, {"lowest": 99.0}])
def test_decode_info_gripper_without_range_or_speed_is_refused(change: dict[str, float]) -> None:
    limits = GripperLimits(drive="width", lowest=5.0, highest=74.0, fastest=60.0)
    info = RecordingInfo(layout=RIGID_LAYOUT, origin="twin", gripper=limits)
    assert decode_info(encode_info(info)).gripper == limits
    with pytest.raises(RecordingError, match="metadata can't be read"):
        decode_info(encode_info(replace(info, gripper=replace(limits, **change))))


def test_finished_recording_is_synced_and_has_checksums(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: synced.append(os.fstat(descriptor).st_size))
    monkeypatch.setattr(os, "fdatasync", lambda descriptor: synced.append(-1))
    path = tmp_path / "run.mcap"
    write_recording(path, MESSAGES)
    # The parallel sync may be the last one to be recorded.
    assert path.stat().st_size in synced
    assert -1 in synced
    with path.open("rb") as stream:
        records = list(StreamReader(stream, emit_chunks=True).records)
    chunks = [record for record in records if isinstance(record, Chunk)]
    (end,) = (record for record in records if isinstance(record, DataEnd))
    assert len(chunks) > 1
    assert all(chunk.uncompressed_crc for chunk in chunks)
    assert end.data_section_crc


def test_recording_of_hardware_has_unix_log_times(tmp_path: Path) -> None:
    path = tmp_path / "bench.mcap"
    zero_ns = 1_790_000_000_123_456_789
    info = RecordingInfo(layout=RIGID_LAYOUT, origin="hardware", clock_zero_unix_ns=zero_ns)
    write_recording(path, MESSAGES[3:4], info)
    with path.open("rb") as stream:
        (_, channel, message) = next(iter(make_reader(stream).iter_messages()))
    assert (channel.topic, message.log_time) == ("/frames", zero_ns + 20_000_000)
