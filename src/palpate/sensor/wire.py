"""Conversion of bytes to messages and of commands to bytes, without I/O.

A packet consists of type, 16-bit length, payload and CRC-32. COBS removes all zeros from the
packet, and a zero ends it (`docs/protocol.md`). The decoder therefore resynchronizes at every zero,
whatever was received before.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from palpate.sensor.array import LinkCounters
from palpate.sensor.wire_messages import (
    MAX_OVERSAMPLING,
    Ack,
    BoardIdentity,
    BoardMessage,
    CellSample,
    Command,
    Contents,
    FrameMessage,
    MessageType,
    Result,
)

_HEAD = struct.Struct("<BH")
_CRC = struct.Struct("<I")
_OVERHEAD = _HEAD.size + _CRC.size
#: Maximum length of an encoded packet; a 16 x 16 frame with all contents has 548 bytes unencoded.
MAX_ENCODED_BYTES = 640
_WRAP = 2**32
_KNOWN = frozenset(int(kind) for kind in MessageType)
_FRAME = int(MessageType.FRAME)

FRAME_HEAD = struct.Struct("<IIBBBBB")
LOADS = struct.Struct("<iBiB")
PRESSURE = struct.Struct("<HH")
SERVO = struct.Struct("<H")
ACK = struct.Struct("<BBBBIII")
IDENTITY = struct.Struct("<BBBBBHBBBBBBHHBIIII")
FULL_SCALE = struct.Struct("<H")
#: Formats of the additional data of a frame, in order of transmission.
_EXTRA = {Contents.LOAD_CELLS: LOADS, Contents.PRESSURE: PRESSURE, Contents.SERVO: SERVO}
_ALL_CONTENTS = int(Contents.LOAD_CELLS | Contents.PRESSURE | Contents.SERVO)


def encode_cobs(data: bytes) -> bytes:
    """Encode with consistent overhead byte stuffing (COBS), without the final zero.

    Source: S. Cheshire and M. Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on
    Networking 7(2), 1999.

    >>> encode_cobs(bytes([0x11, 0x22, 0, 0x33])).hex()
    '0311220233'
    """
    encoded = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= 254:
            encoded.append(255)
            encoded += run[:254]
            run = run[254:]
        encoded.append(len(run) + 1)
        encoded += run
    return bytes(encoded)


def decode_cobs(encoded: bytes | bytearray) -> bytes | None:
    """Decode the output of `encode_cobs`; return None if the bytes are invalid.

    >>> decode_cobs(bytes.fromhex("0311220233")).hex(), decode_cobs(bytes([9, 1]))
    ('11220033', None)
    """
    data, start = bytearray(), 0
    while start < len(encoded):
        code = encoded[start]
        run = encoded[start + 1 : start + code]
        if code == 0 or len(run) != code - 1:
            return None
        data += run
        start += code
        # A code of 255 represents 254 bytes without a zero after them.
        if code < 255 and start < len(encoded):
            data.append(0)
    return bytes(data)


def pack(kind: int, payload: bytes) -> bytes:
    """Return the complete packet of a payload: type, length, CRC-32, COBS encoding, final zero."""
    body = _HEAD.pack(kind, len(payload)) + payload
    return encode_cobs(body + _CRC.pack(zlib.crc32(body))) + b"\0"


def unpack(encoded: bytes | bytearray) -> tuple[int, bytes] | None:
    """Return the type and payload of a packet (without final zero); None if damaged."""
    packet = decode_cobs(encoded)
    if packet is None or len(packet) < _OVERHEAD:
        return None
    body, crc = packet[:-4], packet[-4:]
    kind, length = _HEAD.unpack_from(body)
    if length != len(packet) - _OVERHEAD or _CRC.unpack(crc)[0] != zlib.crc32(body):
        return None
    return kind, body[_HEAD.size :]


def encode_command(command: Command, *, tag: int = 0) -> bytes:
    """Encode `command` as a packet; the board's answer contains the same `tag` (0 to 255).

    Raises `ValueError` if a value does not fit its field. The board checks the other limits.

    >>> from palpate.sensor.wire_messages import Ping
    >>> encode_command(Ping(), tag=7).hex()
    '03870106070aae6cce00'
    """
    values = [(getattr(command, f.name), f.type == "float") for f in fields(command)]
    numbers = [round(1e3 * value) if is_quantity else int(value) for value, is_quantity in values]
    try:
        return pack(command.kind, struct.pack(f"<B{command.struct_format}", tag, *numbers))
    except struct.error as error:
        raise ValueError(f"{command} with tag {tag} can't be sent: {error}") from error


def unpack_frame(
    payload: bytes, *, unwrap: Callable[[int, int, int], tuple[int, int]] | None = None
) -> FrameMessage | None:
    """Return the frame in `payload`; None if the payload is invalid.

    `unwrap`: returns the unwrapped sequence and time for a sequence, time and stream. It is called
        for valid frames only.
    """
    if len(payload) < FRAME_HEAD.size:
        return None
    head = FRAME_HEAD.unpack_from(payload)
    sequence, time_us, stream, oversampling, sides, contents, status = head
    rows, cols = (sides >> 4) + 1, (sides & 0x0F) + 1
    end = FRAME_HEAD.size + 2 * rows * cols
    extra: dict[str, Any] | None = {}
    if contents or len(payload) != end:
        extra = _unpack_extra(payload, end, contents)
    if extra is None or not 1 <= oversampling <= MAX_OVERSAMPLING:
        return None
    if unwrap is not None:
        sequence, time_us = unwrap(sequence, time_us, stream)
    return FrameMessage(
        sequence=sequence,
        time_us=time_us,
        stream=stream,
        oversampling=oversampling,
        status=status,
        counts=np.ndarray((rows, cols), "<u2", payload, FRAME_HEAD.size),
        **extra,
    )


def _unpack_extra(payload: bytes, start: int, contents: int) -> dict[str, Any] | None:
    """Return the fields after a frame's pixels; None if they do not match `contents`."""
    parts = [part for part in _EXTRA if contents & part]
    end = start + sum(_EXTRA[part].size for part in parts)
    if contents > _ALL_CONTENTS or len(payload) != end:
        return None
    extra: dict[str, Any] = {}
    for part in parts:
        values = _EXTRA[part].unpack_from(payload, start)
        start += _EXTRA[part].size
        if part is Contents.LOAD_CELLS:
            cells = zip(values[::2], values[1::2], strict=True)
            extra["load_cells"] = tuple(CellSample(raw=raw, sample=n) for raw, n in cells)
        elif part is Contents.PRESSURE:
            extra["pressure_set_kpa"], extra["pressure_kpa"] = (pa / 1e3 for pa in values)
        else:
            (extra["servo_us"],) = values
    return extra


def unpack_ack(payload: bytes) -> Ack | None:
    """Return the answer in `payload`; None if the payload is invalid."""
    if len(payload) != ACK.size:
        return None
    command, tag, result, stream, next_sequence, time_us, highest_mhz = ACK.unpack(payload)
    if result > max(Result):
        return None
    return Ack(
        command=command,
        tag=tag,
        result=Result(result),
        stream=stream,
        next_sequence=next_sequence,
        time_us=time_us,
        highest_rate_hz=highest_mhz / 1e3,
    )


def unpack_identity(payload: bytes) -> BoardIdentity | None:
    """Return the identity in `payload`; None if the payload is invalid."""
    if len(payload) < IDENTITY.size:
        return None
    tag, protocol, major, minor, patch, *rest = IDENTITY.unpack_from(payload)
    board, full_scale = payload[IDENTITY.size :], 1024
    if protocol > 1:
        if len(board) < FULL_SCALE.size:
            return None
        (full_scale,), board = FULL_SCALE.unpack_from(board), board[FULL_SCALE.size :]
    if not board.isascii():
        return None
    features, rows, cols, oversampling, max_rows, max_cols, max_oversampling, *rest = rest
    settle_us, heartbeat_ms, state, conversion_us, baud, rate_mhz, highest_mhz = rest
    return BoardIdentity(
        tag=tag,
        protocol=protocol,
        version=(major, minor, patch),
        features=features,
        rows=rows,
        cols=cols,
        oversampling=oversampling,
        max_rows=max_rows,
        max_cols=max_cols,
        max_oversampling=max_oversampling,
        settle_us=settle_us,
        heartbeat_ms=heartbeat_ms,
        reset_cause=state & 0x7F,
        streaming=bool(state & 0x80),
        conversion_us=conversion_us,
        baud=baud,
        rate_hz=rate_mhz / 1e3,
        highest_rate_hz=highest_mhz / 1e3,
        board=board.decode("ascii"),
        full_scale=full_scale,
    )


class Decoder:
    """Converts the bytes of a board, in chunks of any size, into messages.

    The decoder stores at most `MAX_ENCODED_BYTES` between calls. It accepts only complete packets
    with the correct length and CRC-32 and counts all others. It unwraps sequence and time within a
    stream, which requires at least one frame every 71 minutes.

    >>> data = bytes.fromhex("03011101010101020c010104010101010103020705a2ffcb0500")  # number 0
    >>> data += bytes.fromhex("03011102020101020c010104010101010103020705656ff7d100")  # number 2
    >>> decoder = Decoder()
    >>> [m.counts.tolist() for m in decoder.feed(data[:9]) + decoder.feed(data[9:])]
    [[[512, 7]], [[512, 7]]]
    >>> decoder.counters.frames, decoder.counters.lost
    (2, 1)
    """

    def __init__(self) -> None:
        self._pending = bytearray()
        self._overlong = False
        self._is_synchronized = False
        self._stream: int | None = None
        self._expected = 0
        self._time_us: int | None = None
        self._frames = self._lost = self._corrupt = self._restarts = 0

    @property
    def counters(self) -> LinkCounters:
        """Counters of the link; bytes before the first zero do not count as corrupt."""
        return LinkCounters(
            frames=self._frames, lost=self._lost, corrupt=self._corrupt, restarts=self._restarts
        )

    def feed(self, data: bytes) -> list[BoardMessage]:
        """Append bytes and return the completed messages, oldest first."""
        messages: list[BoardMessage] = []
        *complete, rest = bytes(data).split(b"\0")
        for piece in complete:
            self._buffer(piece)
            if self._pending or self._overlong:
                self._finish_packet(messages)
            self._is_synchronized = True
        self._buffer(rest)
        return messages

    def _buffer(self, piece: bytes) -> None:
        if self._overlong or len(self._pending) + len(piece) > MAX_ENCODED_BYTES:
            self._overlong = True
            self._pending.clear()
        else:
            self._pending += piece

    def _finish_packet(self, messages: list[BoardMessage]) -> None:
        packet = unpack(self._pending)  # empty after an overlong packet
        message = None if packet is None else self._read_message(*packet)
        if message is not None:
            messages.append(message)
        elif packet is None or packet[0] in _KNOWN:
            self._corrupt += self._is_synchronized
        self._pending.clear()
        self._overlong = False

    def _read_message(self, kind: int, payload: bytes) -> BoardMessage | None:
        if kind == _FRAME:
            return unpack_frame(payload, unwrap=self._count_frame)
        if kind == MessageType.ACK:
            return self._count_answer(unpack_ack(payload))
        if kind == MessageType.IDENTITY:
            return unpack_identity(payload)
        return None

    def _count_frame(self, sequence: int, time_us: int, stream: int) -> tuple[int, int]:
        """Count a frame and the lost frames before it; return its unwrapped sequence and time."""
        ahead = (sequence - self._expected) % _WRAP
        if stream != self._stream or ahead >= _WRAP // 2:
            self._switch_stream(stream, sequence=sequence)
            ahead = (sequence - self._expected) % _WRAP
        if self._time_us is None:
            self._time_us = time_us
        self._frames += 1
        self._lost += ahead
        self._expected += ahead + 1
        self._time_us += (time_us - self._time_us) % _WRAP
        return self._expected - 1, self._time_us

    def _count_answer(self, ack: Ack | None) -> Ack | None:
        """Count the frames lost before an answer, using its next sequence number."""
        if ack is None or ack.stream == 0:
            return ack
        if ack.stream != self._stream:
            self._switch_stream(ack.stream, sequence=ack.next_sequence)
        ahead = (ack.next_sequence - self._expected) % _WRAP
        if ahead < _WRAP // 2:
            self._lost += ahead
            self._expected += ahead
        return ack

    def _switch_stream(self, stream: int, *, sequence: int) -> None:
        """Switch to a stream, and expect its first frame unless it is the first stream."""
        joined_late = self._stream is None
        self._restarts += not joined_late
        self._stream = stream
        self._expected = sequence if joined_late else 0
        self._time_us = None
