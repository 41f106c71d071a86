"""Reads the MCAP records of a truncated or damaged file in bounded memory.

The readers of the mcap package are strict and trust lengths. This reader checks every length
against the file size and a limit, verifies checksums, and stops when the framing is lost.
"""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata
from mcap.writer import MCAP0_MAGIC

from palpate.errors import RecordingError

#: Far above any record of palpate; a damaged length must not fill the memory.
LARGEST_RECORD_BYTES = 32 << 20
_HEAD = struct.Struct("<BQ")
_MESSAGE_HEAD = struct.Struct("<HIQQ")
_CHUNK_HEAD = struct.Struct("<QQQI")
_WANTED = {Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA}

#: Exceptions that malformed content can raise during parsing.
MALFORMED = (struct.error, McapError, ValueError, OverflowError)


McapRecord = Channel | Metadata | Message


@dataclass(slots=True, kw_only=True)
class FileState:
    """Completeness and damage of a file, determined while it is read."""

    #: Whether the footer and the final magic bytes were found.
    complete: bool = False
    #: Chunks, or single records, skipped because of invalid content or a wrong checksum.
    damaged_chunks: int = 0
    #: Bytes at the end that form no complete record.
    unread_bytes: int = 0

    @property
    def is_intact(self) -> bool:
        """Whether nothing is missing or damaged."""
        return self.complete and self.damaged_chunks == 0 and self.unread_bytes == 0


def read_blocks(stream: IO[bytes], *, state: FileState) -> Iterator[list[McapRecord]]:
    """Yield the records of each block (a chunk, or one unchunked record), in file order.

    `stream`: seekable, at its start.
    `state`: updated while reading.
    Raises `RecordingError` if the file doesn't begin like an MCAP file.
    """
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    if stream.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise RecordingError(
            "not an MCAP recording (its first bytes are different); `palpate settle` reads tables"
        )
    while True:
        state.unread_bytes = size - stream.tell()
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        opcode, length = _HEAD.unpack(head)
        if length > size - stream.tell():
            return
        if opcode == Opcode.FOOTER:
            stream.seek(length, io.SEEK_CUR)
            if stream.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
                state.complete = True
                state.unread_bytes = size - stream.tell()
            return
        if opcode not in _WANTED:
            stream.seek(length, io.SEEK_CUR)
            continue
        if length > LARGEST_RECORD_BYTES:
            return
        yield _parse_block(opcode, stream.read(length), state)


def _parse_block(opcode: int, body: bytes, state: FileState) -> list[McapRecord]:
    try:
        if opcode == Opcode.CHUNK:
            return list(_split_chunk(_read_chunk(body)))
        return [_parse_record(opcode, body)]
    except MALFORMED:
        state.damaged_chunks += 1
        return []


def _split_chunk(content: bytes) -> Iterator[McapRecord]:
    at = 0
    while at < len(content):
        opcode, length = _HEAD.unpack_from(content, at)
        at += _HEAD.size
        if length > len(content) - at:
            raise ValueError("a record extends beyond its chunk")
        if opcode in _WANTED and opcode != Opcode.CHUNK:
            yield _parse_record(opcode, content[at : at + length])
        at += length


def _parse_record(opcode: int, body: bytes) -> McapRecord:
    if opcode == Opcode.MESSAGE:
        channel_id, sequence, log_time, publish_time = _MESSAGE_HEAD.unpack_from(body)
        data = body[_MESSAGE_HEAD.size :]
        return Message(channel_id, log_time, data, publish_time, sequence)
    kind = Channel if opcode == Opcode.CHANNEL else Metadata
    record: McapRecord = kind.read(ReadDataStream(io.BytesIO(body)))
    return record


def _read_chunk(body: bytes) -> bytes:
    _, _, size, checksum = _CHUNK_HEAD.unpack_from(body)
    stream = ReadDataStream(io.BytesIO(body[_CHUNK_HEAD.size :]))
    compression = stream.read_prefixed_string()
    packed = stream.read(stream.read8())
    if size > LARGEST_RECORD_BYTES:
        raise ValueError("a chunk is too large")
    content = _decompress(packed, compression=compression, size=size)
    if len(content) != size or (checksum and zlib.crc32(content) != checksum):
        raise ValueError("a chunk's checksum is wrong")
    return content


def _decompress(packed: bytes, *, compression: str, size: int) -> bytes:
    """Decompress a chunk to at most `size` + 1 bytes."""
    try:
        if compression == "zstd":
            with zstandard.ZstdDecompressor().stream_reader(packed) as unpacked:
                return bytes(unpacked.read(size + 1))
        if compression == "lz4":
            return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size + 1))
    except (zstandard.ZstdError, RuntimeError, EOFError) as error:
        raise ValueError(f"a chunk can't be decompressed: {error}") from error
    if compression:
        raise ValueError(f"unknown compression {compression!r}")
    return packed
