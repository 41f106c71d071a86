"""Encoding and decoding of message payloads, and errors for values out of range."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from palpate.sensor.wire import (
    encode_command,
    unpack_ack,
    unpack_identity,
)
from palpate.sensor.wire_messages import (
    NO_READING,
    Ack,
    BoardIdentity,
    CellSample,
    Command,
    FrameMessage,
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
FRAME = FrameMessage(
    sequence=5,
    time_us=6,
    stream=1,
    oversampling=64,
    status=0x10,
    counts=np.array([[0, 65472]], dtype=np.uint16),
    load_cells=(CellSample(raw=NO_READING, sample=0), CellSample(raw=-5, sample=255)),
    pressure_set_kpa=50.0,
    pressure_kpa=49.951,
)


def test_unpack_ack_roundtrip_is_unchanged() -> None:
    assert unpack_ack(pack_ack(ACK)) == ACK


def test_unpack_ack_of_wrong_length_or_result_returns_none() -> None:
    payload = pack_ack(ACK)
    assert unpack_ack(payload[:-1]) is None
    assert unpack_ack(payload + b"\0") is None
    assert unpack_ack(payload[:2] + b"\x06" + payload[3:]) is None


@pytest.mark.parametrize("streaming", [False, True])
def test_unpack_identity_roundtrip_is_unchanged(streaming: bool) -> None:
    identity = replace(IDENTITY, streaming=streaming)
    assert unpack_identity(pack_identity(identity)) == identity


def test_unpack_identity_truncated_or_not_ascii_returns_none() -> None:
    payload = pack_identity(IDENTITY)
    assert unpack_identity(payload[: -len(IDENTITY.board) - 1]) is None
    assert unpack_identity(payload + b"\xff") is None


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
