"""Reads the MCAP records of a truncated or damaged file in bounded memory.

The readers of the mcap package are strict and trust lengths. This reader checks every length
against the file size and a limit, verifies checksums, and stops when the framing is lost.

A chunk has a checksum of its own. A finished file has two more: one of everything before its index,
and one of the index. The description of the rig has its own (`palpate.recording.channels`), so that
it can also be checked in a file that was never finished.
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
#: Start of the index and of its offsets, and the checksum of the index.
_FOOTER = struct.Struct("<QQI")
_DATA_END = struct.Struct("<I")
_WANTED = {Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA}
#: Other records before the index. A chunk with a changed kind must not be skipped without a word.
_SKIPPED = {Opcode.HEADER, Opcode.SCHEMA, Opcode.ATTACHMENT}
#: Channel and size of the list in a message index.
_MESSAGE_INDEX_HEAD = struct.Struct("<HI")

#: Exceptions that malformed content can raise during parsing.
MALFORMED = (struct.error, McapError, ValueError, OverflowError)


McapRecord = Channel | Metadata | Message


@dataclass(slots=True, kw_only=True)
class FileState:
    """Completeness and damage of a file, determined while it is read."""

    #: Whether the end of the data, the footer and the final magic bytes were found.
    complete: bool = False
    #: Chunks, or single records, skipped because of invalid content or a wrong checksum.
    damaged_chunks: int = 0
    #: Bytes at the end that form no complete record.
    unread_bytes: int = 0
    #: Whether the checksums match: of everything before the index, of the index, and of the
    #: description. None without that checksum, as in an unfinished or an older file.
    data_matches: bool | None = None
    index_matches: bool | None = None
    description_matches: bool | None = None

    @property
    def is_intact(self) -> bool:
        """Whether nothing is missing or damaged."""
        lost = self.damaged_chunks or self.unread_bytes
        matches = self.data_matches, self.index_matches, self.description_matches
        return self.complete and not lost and False not in matches

    @property
    def is_description_damaged(self) -> bool:
        """Whether the rig, the layout or the calibration may be wrong.

        Without a checksum of its own, the description is under suspicion if the checksum of the
        whole is wrong and no other damage explains it.
        """
        unexplained = self.data_matches is False and self.damaged_chunks == 0
        return self.description_matches is False or (
            self.description_matches is None and unexplained
        )

    @property
    def is_description_checked(self) -> bool:
        """Whether a checksum confirms the rig, the layout and the calibration."""
        return bool(self.description_matches or self.data_matches)

    def describe(self) -> str:
        """Return what is missing, damaged or unchecked; empty if there is nothing to say.

        >>> FileState(complete=True, damaged_chunks=2, description_matches=True).describe()
        'finished, 2 damaged chunks, 0 unreadable bytes at the end'
        """
        faults = []
        if not self.complete or self.damaged_chunks or self.unread_bytes:
            faults = [
                "finished" if self.complete else "not finished",
                f"{self.damaged_chunks} damaged chunks",
                f"{self.unread_bytes} unreadable bytes at the end",
            ]
        elif self.data_matches is False:
            faults.append("the checksum of the whole is wrong, but every chunk is intact")
        if self.index_matches is False:
            faults.append("its index is damaged")
        if self.is_description_damaged:
            faults.append("its rig, layout and calibration fail their checksum")
        elif not self.is_description_checked:
            faults.append("its rig, layout and calibration can't be checked: no checksum")
        return ", ".join(faults)


def read_blocks(stream: IO[bytes], *, state: FileState) -> Iterator[list[McapRecord]]:
    """Yield the records of each block (a chunk, or one unchunked record), in file order.

    `stream`: seekable, at its start.
    `state`: updated while reading.
    Raises `RecordingError` if the file doesn't begin like an MCAP file.
    """
    size = stream.seek(0, io.SEEK_END)
    stream.seek(0)
    magic = stream.read(len(MCAP0_MAGIC))
    if magic != MCAP0_MAGIC:
        raise RecordingError(
            "not an MCAP recording (its first bytes are different); `palpate settle` reads tables"
        )
    # The checksum of the data up to the end of the data, then that of the index.
    checksum, has_data_end = zlib.crc32(magic), False
    while True:
        state.unread_bytes = size - stream.tell()
        head = stream.read(_HEAD.size)
        if len(head) < _HEAD.size:
            return
        opcode, length = _HEAD.unpack(head)
        if length > size - stream.tell():
            return
        if opcode == Opcode.FOOTER:
            footer = stream.read(min(length, _FOOTER.size))
            if length == _FOOTER.size and stream.read(len(MCAP0_MAGIC)) == MCAP0_MAGIC:
                state.complete = has_data_end
                state.unread_bytes = size - stream.tell()
                *_, stored = _FOOTER.unpack(footer)
                checksum = zlib.crc32(head + footer[:-4], checksum)
                state.index_matches = checksum == stored if stored else None
            return
        if length > LARGEST_RECORD_BYTES:
            return
        body = stream.read(length)
        if opcode == Opcode.DATA_END and length == _DATA_END.size:
            (stored,) = _DATA_END.unpack(body)
            state.data_matches = checksum == stored if stored else None
            checksum, has_data_end = 0, True
            continue
        checksum = zlib.crc32(body, zlib.crc32(head, checksum))
        if has_data_end:
            continue
        if opcode in _WANTED:
            yield _parse_block(opcode, body, state)
        elif opcode not in _SKIPPED and not _is_message_index(opcode, body):
            state.damaged_chunks += 1


def _is_message_index(opcode: int, body: bytes) -> bool:
    if opcode != Opcode.MESSAGE_INDEX or len(body) < _MESSAGE_INDEX_HEAD.size:
        return False
    _, size = _MESSAGE_INDEX_HEAD.unpack_from(body)
    return bool(size == len(body) - _MESSAGE_INDEX_HEAD.size)


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
