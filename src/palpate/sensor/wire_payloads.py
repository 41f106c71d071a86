"""The payloads of packets: messages and commands to fields of fixed places, and back.

`docs/protocol.md` has the tables that this follows.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from palpate.sensor.wire_messages import (
    MAX_OVERSAMPLING,
    Ack,
    BoardIdentity,
    CellSample,
    Command,
    CommandType,
    Contents,
    FrameMessage,
    Identify,
    Ping,
    Result,
    SetCeiling,
    SetLayout,
    SetOversampling,
    SetPressure,
    SetRate,
    Start,
    Stop,
)

FRAME_HEAD = struct.Struct("<IIBBBBB")
LOADS = struct.Struct("<iBiB")
PRESSURE = struct.Struct("<HH")
ACK = struct.Struct("<BBBBIII")
IDENTITY = struct.Struct("<BBBBBHBBBBBBHHBIIII")

_ALL_CONTENTS = int(Contents.LOAD_CELLS | Contents.PRESSURE)


@dataclass(frozen=True, slots=True)
class _CommandForm:
    kind: CommandType
    layout: str
    values: Callable[..., tuple[int, ...]] = lambda _: ()


_COMMANDS: dict[type[Command], _CommandForm] = {
    Identify: _CommandForm(CommandType.IDENTIFY, ""),
    SetLayout: _CommandForm(CommandType.LAYOUT, "BBH", lambda c: (c.rows, c.cols, c.settle_us)),
    SetRate: _CommandForm(CommandType.RATE, "I", lambda c: (round(c.rate_hz * 1e3),)),
    SetOversampling: _CommandForm(CommandType.OVERSAMPLING, "B", lambda c: (c.conversions,)),
    Start: _CommandForm(CommandType.START, "B", lambda c: (int(c.contents),)),
    Stop: _CommandForm(CommandType.STOP, ""),
    Ping: _CommandForm(CommandType.PING, ""),
    SetPressure: _CommandForm(
        CommandType.PRESSURE,
        "HI",
        lambda c: (round(c.target_kpa * 1e3), round(c.slew_kpa_per_s * 1e3)),
    ),
    SetCeiling: _CommandForm(CommandType.CEILING, "H", lambda c: (c.counts,)),
}


def pack_command(command: Command, *, tag: int) -> tuple[int, bytes]:
    """Return the type and payload of a command.

    Raises `ValueError` if a value does not fit its field; whether it makes sense is for the board
    to decide.
    """
    form = _COMMANDS[type(command)]
    try:
        return form.kind, struct.pack(f"<B{form.layout}", tag, *form.values(command))
    except struct.error as error:
        raise ValueError(f"{command} with tag {tag} can't be sent: {error}") from error


def _as_sent(sequence: int, time_us: int, _stream: int) -> tuple[int, int]:
    return sequence, time_us


def unpack_frame(
    payload: bytes, *, place: Callable[[int, int, int], tuple[int, int]] = _as_sent
) -> FrameMessage | None:
    """Return the frame in `payload`, or None if it isn't one.

    `place` turns the 32-bit sequence and time and the stream into unwrapped sequence and time; it
    is called for valid frames only.
    """
    if len(payload) < FRAME_HEAD.size:
        return None
    head = FRAME_HEAD.unpack_from(payload)
    sequence, time_us, stream, oversampling, sides, contents, status = head
    rows, cols = (sides >> 4) + 1, (sides & 0x0F) + 1
    end = FRAME_HEAD.size + 2 * rows * cols
    if not 1 <= oversampling <= MAX_OVERSAMPLING:
        return None
    loads: tuple[CellSample, ...] = ()
    set_kpa = read_kpa = None
    if contents:
        if contents > _ALL_CONTENTS or len(payload) != end + _extra_size(contents):
            return None
        loads, set_kpa, read_kpa = _unpack_extra(payload, end, contents)
    elif len(payload) != end:
        return None
    pixels = np.ndarray((rows, cols), "<u2", payload, FRAME_HEAD.size)
    sequence, time_us = place(sequence, time_us, stream)
    return FrameMessage(
        sequence=sequence,
        time_us=time_us,
        stream=stream,
        oversampling=oversampling,
        status=status,
        counts=pixels,
        load_cells=loads,
        pressure_set_kpa=set_kpa,
        pressure_kpa=read_kpa,
    )


def _extra_size(contents: int) -> int:
    return (LOADS.size if contents & Contents.LOAD_CELLS else 0) + (
        PRESSURE.size if contents & Contents.PRESSURE else 0
    )


def _unpack_extra(
    payload: bytes, offset: int, contents: int
) -> tuple[tuple[CellSample, ...], float | None, float | None]:
    loads: tuple[CellSample, ...] = ()
    if contents & Contents.LOAD_CELLS:
        raw_0, sample_0, raw_1, sample_1 = LOADS.unpack_from(payload, offset)
        loads = (CellSample(raw=raw_0, sample=sample_0), CellSample(raw=raw_1, sample=sample_1))
        offset += LOADS.size
    if not contents & Contents.PRESSURE:
        return loads, None, None
    set_pa, read_pa = PRESSURE.unpack_from(payload, offset)
    return loads, set_pa / 1e3, read_pa / 1e3


def unpack_ack(payload: bytes) -> Ack | None:
    """Return the answer in `payload`, or None if it isn't one."""
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
    """Return the identity in `payload`, or None if it isn't one."""
    board = payload[IDENTITY.size :]
    if len(payload) < IDENTITY.size or not board.isascii():
        return None
    tag, protocol, major, minor, patch, *rest = IDENTITY.unpack_from(payload)
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
    )
