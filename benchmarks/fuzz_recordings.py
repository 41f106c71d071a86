"""Fuzz the recording reader: no crash, no hang, no unbounded memory.

Run `python benchmarks/fuzz_recordings.py --cases 1000000`; the tests run a few of these cases. A
case is a recording with changed bytes, replaced lengths, removed, duplicated or inserted pieces, or
noise after a valid start. One of the recordings has no checksums and no compression, so that the
damage reaches the records and their JSON.
"""

from __future__ import annotations

import argparse
import io
import random
import resource
import struct
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType, Writer

from palpate.errors import RecordingError
from palpate.gripper.interface import GripperState
from palpate.recording import Event, LoadCells, RecordingInfo, RecordingReader, recover
from palpate.recording.channels import METADATA_NAME, RecordedMessage, encode, encode_info, topic_of
from palpate.recording.writer import register_channels
from palpate.sensor.array import RIGID_LAYOUT, Frame

LENGTHS = (0, 1, 2**31 - 1, 2**32 - 1, 2**40, 2**63 - 1, 2**63, 2**64 - 1)


def create_recordings() -> list[bytes]:
    """Return the recordings to damage, with and without checksums."""
    messages: list[RecordedMessage] = [Event(time_s=0.0, name="note", text="ripe")]
    for k in range(6):
        messages.append(GripperState(time_s=k / 10, width_mm=50.0))
        messages.append(Frame(time_s=k / 10, sequence=k, counts=np.full((4, 2), 300 + k)))
    messages.append(LoadCells(time_s=0.6, raw=(1, -2), force_n=(0.5, 0.6)))
    made = []
    for compression in (CompressionType.ZSTD, CompressionType.LZ4, CompressionType.NONE):
        content = io.BytesIO()
        guarded = compression is not CompressionType.NONE
        writer = Writer(content, compression=compression, enable_crcs=guarded)
        writer.start()
        info = RecordingInfo(layout=RIGID_LAYOUT, origin="twin", seed=1)
        writer.add_metadata(METADATA_NAME, encode_info(info))
        channels = register_channels(writer)
        for number, message in enumerate(messages):
            time_ns = round(message.time_s * 1e9)
            writer.add_message(
                channels[topic_of(message)],
                log_time=time_ns,
                data=encode(message),
                publish_time=time_ns,
            )
            if number == len(messages) // 2:
                writer.flush()
        writer.finish()
        made.append(content.getvalue())
    return made


def change_bytes(rng: random.Random, content: bytearray) -> bytearray:
    for _ in range(rng.randint(1, 8)):
        content[rng.randrange(len(content))] = rng.randrange(256)
    return content


def truncate(rng: random.Random, content: bytearray) -> bytearray:
    return content[: rng.randrange(len(content))]


def replace_length(rng: random.Random, content: bytearray) -> bytearray:
    struct.pack_into("<Q", content, rng.randrange(len(content) - 8), rng.choice(LENGTHS))
    return content


def remove_bytes(rng: random.Random, content: bytearray) -> bytearray:
    start = rng.randrange(8, len(content))
    return content[:start] + content[start + rng.randint(1, 60) :]


def duplicate_bytes(rng: random.Random, content: bytearray) -> bytearray:
    start = rng.randrange(8, len(content))
    return content[:start] + content[start : start + rng.randint(1, 200)] + content[start:]


def insert_bytes(rng: random.Random, content: bytearray) -> bytearray:
    start = rng.randrange(8, len(content))
    return content[:start] + rng.randbytes(rng.randint(1, 60)) + content[start:]


def append_noise(rng: random.Random, content: bytearray) -> bytearray:
    start = rng.randrange(0, len(content))
    return content[:start] + rng.randbytes(rng.randint(0, 500))


MUTATIONS: tuple[Callable[[random.Random, bytearray], bytearray], ...] = (
    change_bytes, change_bytes, truncate, replace_length,
    remove_bytes, duplicate_bytes, insert_bytes, append_noise,
)  # fmt: skip


def draw_cases(count: int, *, seed: int) -> Iterator[bytes]:
    """Yield `count` damaged recordings, deterministic for a seed."""
    rng = random.Random(seed)
    whole = create_recordings()
    for _ in range(count):
        content = bytearray(rng.choice(whole))
        for _ in range(rng.choice((1, 1, 2))):
            content = rng.choice(MUTATIONS)(rng, content) or bytearray(b"\0" * 9)
            if len(content) < 16:
                content += bytes(16)
        yield bytes(content)


def read_case(content: bytes, *, path: Path, recovered: Path | None = None) -> str:
    """Read one case and optionally recover it; return the result or raise."""
    path.write_bytes(content)
    try:
        with RecordingReader(path) as reader:
            for _ in reader.readable_messages():
                pass
        ended = "read"
    except RecordingError:
        ended = "refused"
    if recovered is not None:
        try:
            recover(path, recovered)
        except RecordingError:
            return f"{ended}, not recovered"
        return f"{ended}, recovered"
    return ended


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=1_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    ended: Counter[str] = Counter()
    slowest_s = 0.0
    start_s = time.perf_counter()
    memory = Path("/dev/shm")
    with tempfile.TemporaryDirectory(dir=memory if memory.is_dir() else None) as folder:
        path, recovered = Path(folder, "case.mcap"), Path(folder, "recovered.mcap")
        for number, content in enumerate(draw_cases(options.cases, seed=options.seed)):
            case_s = time.perf_counter()
            ended[read_case(content, path=path, recovered=None if number % 20 else recovered)] += 1
            slowest_s = max(slowest_s, time.perf_counter() - case_s)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{options.cases} cases in {time.perf_counter() - start_s:.0f} s: {dict(ended)}")
    print(f"slowest case {slowest_s * 1e3:.0f} ms, peak memory {peak_mb:.0f} MB")


if __name__ == "__main__":
    main()
