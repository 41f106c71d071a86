"""Bytes to messages and commands to bytes, in any chunking, without input or output.

A packet is type, 16-bit length, payload and CRC-32, made free of zeros by COBS and ended by a zero
(`docs/protocol.md`). A zero therefore always means "the next packet begins here": whatever
happened before it, the decoder is back in step after it.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from palpate.sensor.wire_messages import Ack, BoardMessage, Command, MessageType
from palpate.sensor.wire_payloads import (
    pack_command,
    unpack_ack,
    unpack_frame,
    unpack_identity,
)

_HEAD = struct.Struct("<BH")
_CRC = struct.Struct("<I")
_OVERHEAD = _HEAD.size + _CRC.size
#: Longest stuffed packet that is taken: a 16 x 16 frame with everything is 548 bytes.
MAX_STUFFED_BYTES = 640
_WRAP = 2**32
_KNOWN = frozenset(int(kind) for kind in MessageType)
_FRAME = int(MessageType.FRAME)


def stuff(data: bytes) -> bytes:
    """Encode by consistent overhead byte stuffing (COBS), without the final zero.

    Source: S. Cheshire and M. Baker, "Consistent Overhead Byte Stuffing", IEEE/ACM Transactions on
    Networking 7(2), 1999.

    >>> stuff(bytes([0x11, 0x22, 0, 0x33])).hex()
    '0311220233'
    """
    stuffed = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= 254:
            stuffed.append(255)
            stuffed += run[:254]
            run = run[254:]
        stuffed.append(len(run) + 1)
        stuffed += run
    return bytes(stuffed)


def unstuff(stuffed: bytes | bytearray) -> bytes | None:
    """Undo `stuff`; None if the bytes are not of that form.

    >>> unstuff(bytes.fromhex("0311220233")).hex(), unstuff(bytes([9, 1]))
    ('11220033', None)
    """
    data = bytearray(stuffed)
    end, at = len(data), 0
    long_runs = []
    while at < end:
        code = data[at]
        data[at] = 0
        at += code
        if code == 255:
            long_runs.append(at)
        elif code == 0:
            return None
    if at != end:
        return None
    # A code of 255 means 254 bytes with no zero after them.
    for position in reversed(long_runs):
        if position < end:
            del data[position]
    return bytes(data[1:])


def pack(kind: int, payload: bytes) -> bytes:
    """Return the whole packet of a payload: type, length, CRC-32, stuffing, final zero."""
    body = _HEAD.pack(kind, len(payload)) + payload
    return stuff(body + _CRC.pack(zlib.crc32(body))) + b"\0"


def unpack(stuffed: bytes | bytearray) -> tuple[int, bytes] | None:
    """Return type and payload of a packet given without its final zero; None if it is damaged."""
    packet = unstuff(stuffed)
    if packet is None or len(packet) < _OVERHEAD:
        return None
    body, crc = packet[:-4], packet[-4:]
    kind, length = _HEAD.unpack_from(body)
    if length != len(packet) - _OVERHEAD or _CRC.unpack(crc)[0] != zlib.crc32(body):
        return None
    return kind, body[_HEAD.size :]


def encode_command(command: Command, *, tag: int = 0) -> bytes:
    """Return the bytes that send `command`; the answer carries the same `tag` (0 to 255).

    Raises `ValueError` if a value does not fit its field.

    >>> from palpate.sensor.wire_messages import Ping
    >>> encode_command(Ping(), tag=7).hex()
    '03870106070aae6cce00'
    """
    return pack(*pack_command(command, tag=tag))


@dataclass(frozen=True, slots=True, kw_only=True)
class WireCounters:
    """Counts of a decoder so far."""

    #: Frames accepted.
    frames: int = 0
    #: Frames that the numbering shows to be missing, on the link or on the board.
    lost: int = 0
    #: Packets rejected (the cut-off piece before the very first zero is not one).
    corrupt: int = 0
    #: Sound packets of a type that this version doesn't know.
    unknown: int = 0
    #: Streams begun after the first: a start command or a reset of the board.
    restarts: int = 0
    #: Bytes in rejected packets and before the first zero.
    rejected_bytes: int = 0


class Decoder:
    """Turns the bytes of a board into messages; feed it whatever came, in any pieces.

    It keeps at most `MAX_STUFFED_BYTES` between calls. Only whole packets with the right length
    and CRC-32 are taken; the rest is counted. Sequence and time are unwrapped within a stream,
    which needs at least one frame in every 71 minutes.

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
        self._in_step = False
        self._stream: int | None = None
        self._expected = 0
        self._time_us: int | None = None
        self._frames = self._lost = self._corrupt = 0
        self._unknown = self._restarts = self._rejected_bytes = 0

    @property
    def counters(self) -> WireCounters:
        """The counts so far."""
        return WireCounters(
            frames=self._frames,
            lost=self._lost,
            corrupt=self._corrupt,
            unknown=self._unknown,
            restarts=self._restarts,
            rejected_bytes=self._rejected_bytes,
        )

    def feed(self, data: bytes) -> list[BoardMessage]:
        """Take more bytes; return the messages that they complete, oldest first."""
        messages: list[BoardMessage] = []
        *complete, rest = bytes(data).split(b"\0")
        for piece in complete:
            self._keep(piece)
            if self._pending or self._overlong:
                self._finish(messages)
            self._in_step = True
        self._keep(rest)
        return messages

    def _keep(self, piece: bytes) -> None:
        if self._overlong or len(self._pending) + len(piece) > MAX_STUFFED_BYTES:
            self._overlong = True
            self._rejected_bytes += len(self._pending) + len(piece)
            self._pending.clear()
        else:
            self._pending += piece

    def _finish(self, messages: list[BoardMessage]) -> None:
        packet = unpack(self._pending)  # nothing is kept of an overlong one
        message = None if packet is None else self._read(*packet)
        if message is not None:
            messages.append(message)
        elif packet is not None and packet[0] not in _KNOWN:
            self._unknown += 1
        else:
            self._corrupt += self._in_step
            self._rejected_bytes += len(self._pending)
        self._pending.clear()
        self._overlong = False

    def _read(self, kind: int, payload: bytes) -> BoardMessage | None:
        if kind == _FRAME:
            return unpack_frame(payload, place=self._place)
        if kind == MessageType.ACK:
            return self._account(unpack_ack(payload))
        if kind == MessageType.IDENTITY:
            return unpack_identity(payload)
        return None

    def _place(self, sequence: int, time_us: int, stream: int) -> tuple[int, int]:
        """Count a frame and what is missing before it; return its unwrapped sequence and time."""
        ahead = (sequence - self._expected) % _WRAP
        if stream != self._stream or ahead >= _WRAP // 2:
            self._enter(stream, sequence=sequence)
            ahead = (sequence - self._expected) % _WRAP
        if self._time_us is None:
            self._time_us = time_us
        self._frames += 1
        self._lost += ahead
        self._expected += ahead + 1
        self._time_us += (time_us - self._time_us) % _WRAP
        return self._expected - 1, self._time_us

    def _account(self, ack: Ack | None) -> Ack | None:
        """Count what is missing before an answer: it states which frames went before it."""
        if ack is None or ack.stream == 0:
            return ack
        if ack.stream != self._stream:
            self._enter(ack.stream, sequence=ack.next_sequence)
        ahead = (ack.next_sequence - self._expected) % _WRAP
        if ahead < _WRAP // 2:
            self._lost += ahead
            self._expected += ahead
        return ack

    def _enter(self, stream: int, *, sequence: int) -> None:
        """Follow another stream: from its beginning, unless it is the first one met."""
        joined_late = self._stream is None
        self._restarts += not joined_late
        self._stream = stream
        self._expected = sequence if joined_late else 0
        self._time_us = None
