"""Encode the messages of a board, for simulated boards in tests and benchmarks.

The format is specified in `docs/protocol.md` and decoded by `palpate.sensor.wire`.
"""

from __future__ import annotations

import numpy as np

from palpate.sensor.wire import ACK, FRAME_HEAD, FULL_SCALE, IDENTITY, LOADS, PRESSURE, SERVO, pack
from palpate.sensor.wire_messages import (
    MAX_SIDE,
    Ack,
    BoardIdentity,
    BoardMessage,
    Contents,
    FrameMessage,
    MessageType,
)


def encode_message(message: BoardMessage) -> bytes:
    """Return the packet of a board's message."""
    if isinstance(message, FrameMessage):
        return pack(MessageType.FRAME, pack_frame(message))
    if isinstance(message, Ack):
        return pack(MessageType.ACK, pack_ack(message))
    return pack(MessageType.IDENTITY, pack_identity(message))


def pack_frame(frame: FrameMessage) -> bytes:
    """Return the payload of a frame; sequence and time are truncated to 32 bits."""
    counts = np.asarray(frame.counts)
    rows, cols = counts.shape
    if not (1 <= rows <= MAX_SIDE and 1 <= cols <= MAX_SIDE):
        raise ValueError(f"a frame of {rows} x {cols} pixels: rows and cols must be 1 to 16")
    contents, extra = Contents.PIXELS, b""
    if frame.load_cells:
        contents |= Contents.LOAD_CELLS
        first, second = frame.load_cells
        extra += LOADS.pack(first.raw, first.sample, second.raw, second.sample)
    if frame.pressure_set_kpa is not None and frame.pressure_kpa is not None:
        contents |= Contents.PRESSURE
        extra += PRESSURE.pack(round(frame.pressure_set_kpa * 1e3), round(frame.pressure_kpa * 1e3))
    if frame.servo_us is not None:
        contents |= Contents.SERVO
        extra += SERVO.pack(frame.servo_us)
    head = FRAME_HEAD.pack(
        frame.sequence & 0xFFFFFFFF,
        frame.time_us & 0xFFFFFFFF,
        frame.stream,
        frame.oversampling,
        (rows - 1) << 4 | (cols - 1),
        contents,
        frame.status,
    )
    return head + counts.astype("<u2").tobytes() + extra


def pack_ack(ack: Ack) -> bytes:
    """Return the payload of an acknowledgement."""
    return ACK.pack(
        ack.command,
        ack.tag,
        ack.result,
        ack.stream,
        ack.next_sequence & 0xFFFFFFFF,
        ack.time_us & 0xFFFFFFFF,
        round(ack.highest_rate_hz * 1e3),
    )


def pack_identity(identity: BoardIdentity) -> bytes:
    """Return the payload of an identity, in its own protocol version."""
    name = identity.board.encode("ascii")
    if identity.protocol > 1:
        name = FULL_SCALE.pack(identity.full_scale) + name
    head = IDENTITY.pack(
        identity.tag,
        identity.protocol,
        *identity.version,
        identity.features,
        identity.rows,
        identity.cols,
        identity.oversampling,
        identity.max_rows,
        identity.max_cols,
        identity.max_oversampling,
        identity.settle_us,
        identity.heartbeat_ms,
        identity.reset_cause | identity.streaming << 7,
        identity.conversion_us,
        identity.baud,
        round(identity.rate_hz * 1e3),
        round(identity.highest_rate_hz * 1e3),
    )
    return head + name
