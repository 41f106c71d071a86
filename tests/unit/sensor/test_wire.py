"""The wire: packets, losses, wraps, restarts, garbage, chunks of any size, and payloads."""

from __future__ import annotations

import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from palpate.sensor.array import LinkCounters
from palpate.sensor.wire import (
    MAX_ENCODED_BYTES,
    Decoder,
    decode_cobs,
    encode_cobs,
    encode_command,
    pack,
    unpack,
    unpack_ack,
    unpack_identity,
)
from palpate.sensor.wire_messages import (
    Ack,
    BoardIdentity,
    BoardMessage,
    Command,
    FrameMessage,
    MessageType,
    Ping,
    Result,
    SetLayout,
    SetPressure,
    SetRate,
)
from palpate_studies.board_bytes import encode_message, pack_ack, pack_identity

WRAP = 2**32


def make_frame(sequence: int, *, stream: int = 9, time_us: int | None = None) -> FrameMessage:
    return FrameMessage(
        sequence=sequence,
        time_us=4000 * sequence if time_us is None else time_us,
        stream=stream,
        oversampling=1,
        status=0,
        counts=np.arange(8, dtype=np.uint16).reshape(4, 2) * 140,
    )


def encode_frames(*sequences: int, stream: int = 9) -> bytes:
    return b"".join(encode_message(make_frame(number, stream=stream)) for number in sequences)


def encode_ack(next_sequence: int, *, stream: int = 9) -> bytes:
    answer = Ack(
        command=Ping.kind, tag=1, result=Result.OK, stream=stream, next_sequence=next_sequence
    )
    return encode_message(answer)


def frames_in(messages: list[BoardMessage]) -> list[FrameMessage]:
    return [message for message in messages if isinstance(message, FrameMessage)]


def decode_sequences(decoder: Decoder, data: bytes) -> list[int]:
    return [message.sequence for message in frames_in(decoder.feed(data))]


def test_encoded_packets_match_the_examples_on_the_protocol_page() -> None:
    text = (Path(__file__).parents[3] / "docs" / "protocol.md").read_text()
    example = FrameMessage(
        sequence=258,
        time_us=1_000_000,
        stream=9,
        oversampling=1,
        status=0,
        counts=np.array([[512, 7]], dtype=np.uint16),
    )
    for data in (encode_command(Ping(), tag=7), encode_message(example)):
        assert f"`{data.hex(' ').upper()}`" in text


# -- losses, wraps, restarts and garbage ----------------------------------------------------------

#: A stream, the numbers of its frames, and what is counted.
STREAMS = {
    "gaps": (encode_frames(0, 1, 4, 5, 9), [0, 1, 4, 5, 9], LinkCounters(frames=5, lost=5)),
    "nothing is lost before the first frame": (
        encode_frames(700, 701),
        [700, 701],
        LinkCounters(frames=2),
    ),
    "frames lost before an answer are counted once": (
        encode_frames(0, 1) + encode_ack(5) + encode_frames(5, 6) + encode_ack(7),
        [0, 1, 5, 6],
        LinkCounters(frames=4, lost=3),
    ),
    "lost between an answer and the first frame": (
        encode_ack(0) + encode_frames(2),
        [2],
        LinkCounters(frames=1, lost=2),
    ),
    "an answer older than the last frame": (
        encode_frames(0, 1, 2) + encode_ack(1) + encode_frames(3),
        [0, 1, 2, 3],
        LinkCounters(frames=4),
    ),
    "an answer without a stream": (
        encode_frames(3) + encode_ack(0, stream=0) + encode_frames(4),
        [3, 4],
        LinkCounters(frames=2),
    ),
    "lost across the wrap": (
        encode_frames(WRAP - 2, WRAP + 3) + encode_ack(WRAP + 6),
        [WRAP - 2, WRAP + 3],
        LinkCounters(frames=2, lost=6),
    ),
    "a new stream": (
        encode_frames(10, 11) + encode_frames(0, 1, stream=10),
        [10, 11, 0, 1],
        LinkCounters(frames=4, restarts=1),
    ),
    "lost at the start of a new stream": (
        encode_frames(10) + encode_frames(3, stream=10),
        [10, 3],
        LinkCounters(frames=2, lost=3, restarts=1),
    ),
    "a decreasing number is a restart": (
        encode_frames(500, 501) + encode_frames(0, 1),
        [500, 501, 0, 1],
        LinkCounters(frames=4, restarts=1),
    ),
    "a packet of unknown type": (
        encode_frames(0) + pack(0x42, b"from the future") + encode_frames(1),
        [0, 1],
        LinkCounters(frames=2),
    ),
}


@pytest.mark.parametrize("name", STREAMS)
def test_decoder_returns_and_counts_the_frames_of_a_stream(name: str) -> None:
    data, sequences, counters = STREAMS[name]
    decoder = Decoder()
    assert decode_sequences(decoder, data) == sequences
    assert decoder.counters == counters


def test_decoder_unwraps_the_time_within_a_stream() -> None:
    started_us = 5 * WRAP - 9000
    data = b"".join(
        encode_message(make_frame(WRAP - 3 + k, time_us=started_us + 4000 * k)) for k in range(6)
    )
    early = make_frame(0, stream=10, time_us=20)
    *got, last = frames_in(Decoder().feed(data + encode_message(early)))
    assert [each.sequence for each in got] == [WRAP - 3 + k for k in range(6)]
    assert [each.time_us - got[0].time_us for each in got] == [4000 * k for k in range(6)]
    assert (got[0].time_us, last.time_us) == (started_us % WRAP, 20)


def test_decoder_started_inside_a_frame_loses_only_that_frame() -> None:
    data = encode_frames(4, 5, 6)
    for start in range(1, len(encode_frames(4))):
        decoder = Decoder()
        assert decode_sequences(decoder, data[start:])[-2:] == [5, 6]
        assert decoder.counters.corrupt == 0


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        bytes(13),
        encode_frames(0)[:1],
        bytes([0] * 9 + [1, 0x31, 0, 0]) + bytes(15),
        bytes([0] * 9 + [65, 0x31, 0, 0]) + bytes(16),
        bytes([0] * 9 + [1, 0x31, 4, 0]) + bytes(16),
        bytes([0] * 9 + [1, 0x31, 1, 0]) + bytes(16 + 9),
    ],
    ids=["empty", "no pixels", "short", "pixel cut", "oversampling", "contents", "load cell cut"],
)
def test_decoder_rejects_an_invalid_frame_with_a_correct_checksum(payload: bytes) -> None:
    decoder = Decoder()
    assert decoder.feed(b"\0" + pack(MessageType.FRAME, payload)) == []
    assert (decoder.counters.corrupt, decoder.counters.frames) == (1, 0)


@pytest.mark.parametrize("wrong_by", [-2, -1, 1, 255])
def test_unpack_rejects_a_packet_of_the_wrong_length(wrong_by: int) -> None:
    def packet(length: int) -> bytes:
        body = struct.pack("<BH", MessageType.ACK, length) + b"payload"
        return encode_cobs(body + struct.pack("<I", zlib.crc32(body)))

    assert unpack(packet(7)) == (MessageType.ACK, b"payload")
    assert unpack(packet(7 + wrong_by)) is None


@pytest.mark.parametrize("damaged", ["0311", "031122023344", "ff01", "0003", "010002"])
def test_decode_cobs_returns_none_for_invalid_bytes(damaged: str) -> None:
    assert decode_cobs(bytes.fromhex(damaged)) is None


# -- chunks and memory ----------------------------------------------------------------------------


def test_decoder_accepts_the_longest_frame_and_rejects_a_longer_packet() -> None:
    largest = replace(make_frame(0), counts=np.full((16, 16), 1023, dtype=np.uint16))
    data = encode_message(largest)
    assert len(data) <= MAX_ENCODED_BYTES
    decoder = Decoder()
    assert len(decoder.feed(data)) == 1
    too_long = pack(0x42, b"\x01" * MAX_ENCODED_BYTES)
    assert decoder.feed(too_long + data) != []
    assert decoder.counters == LinkCounters(frames=2, corrupt=1, restarts=1)


ACK = Ack(
    command=SetRate.kind,
    tag=200,
    result=Result.TOO_FAST,
    stream=7,
    next_sequence=2**32 - 1,
    time_us=123,
    highest_rate_hz=612.345,
)
IDENTITY = BoardIdentity(
    tag=3, protocol=1, version=(1, 2, 3), features=3, rows=6, cols=2, oversampling=4,
    max_rows=16, max_cols=16, max_oversampling=64, settle_us=20, heartbeat_ms=500,
    reset_cause=8, streaming=True, conversion_us=104, baud=1_000_000,
    rate_hz=250.0, highest_rate_hz=701.5, board="Arduino Mega 2560",
)  # fmt: skip


def test_unpack_ack_roundtrips_and_refuses_a_wrong_length_or_result() -> None:
    payload = pack_ack(ACK)
    assert unpack_ack(payload) == ACK
    for wrong in (payload[:-1], payload + b"\0", payload[:2] + b"\x06" + payload[3:]):
        assert unpack_ack(wrong) is None


@pytest.mark.parametrize("streaming", [False, True])
def test_unpack_identity_roundtrips_and_refuses_truncated_or_other_than_ascii(
    streaming: bool,
) -> None:
    identity = replace(IDENTITY, streaming=streaming)
    payload = pack_identity(identity)
    assert unpack_identity(payload) == identity
    for wrong in (payload[: -len(IDENTITY.board) - 1], payload + b"\xff"):
        assert unpack_identity(wrong) is None


@pytest.mark.parametrize(
    ("command", "tag"),
    [
        (SetLayout(rows=1, cols=1, settle_us=70_000), 1),
        (SetRate(rate_hz=5e6), 1),
        (SetPressure(target_kpa=-1.0, slew_kpa_per_s=1.0), 1),
        (Ping(), 256),
    ],
)
def test_encode_command_with_a_value_out_of_range_raises(command: Command, tag: int) -> None:
    with pytest.raises(ValueError, match="can't be sent"):
        encode_command(command, tag=tag)


@pytest.mark.parametrize("length", [0, 1, 253, 254, 255, 508, 509])
@pytest.mark.parametrize("after", [b"", b"\0", b"\0\x02", b"\0\0"])
def test_cobs_roundtrips_a_long_run_without_zero(length: int, after: bytes) -> None:
    data = b"\x01" * length + after
    assert decode_cobs(encode_cobs(data)) == data
