"""Encoding and decoding of message payloads, and errors for values out of range."""

from __future__ import annotations

from dataclasses import replace

import pytest

from palpate.sensor.wire import (
    encode_command,
    unpack_ack,
    unpack_identity,
)
from palpate.sensor.wire_messages import (
    Ack,
    BoardIdentity,
    Command,
    Ping,
    Result,
    SetCeiling,
    SetLayout,
    SetOversampling,
    SetPressure,
    SetRate,
)
from palpate_studies.board_bytes import pack_ack, pack_identity

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
        (SetLayout(rows=256, cols=1), 1),
        (SetLayout(rows=1, cols=1, settle_us=70_000), 1),
        (SetRate(rate_hz=-1.0), 1),
        (SetRate(rate_hz=5e6), 1),
        (SetOversampling(conversions=300), 1),
        (SetPressure(target_kpa=-1.0, slew_kpa_per_s=1.0), 1),
        (SetCeiling(counts=70_000), 1),
        (Ping(), 256),
    ],
)
def test_encode_command_with_a_value_out_of_range_raises(command: Command, tag: int) -> None:
    with pytest.raises(ValueError, match="can't be sent"):
        encode_command(command, tag=tag)
