"""Messages from the board and commands from the host.

`docs/protocol.md` is the specification. `palpate.sensor.wire` encodes and decodes the messages.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

#: Version 1, without servo and without full scale in the identity, is still supported.
PROTOCOL_VERSION = 2
MAX_SIDE = 16
MAX_OVERSAMPLING = 64
MAX_PRESSURE_KPA = 50.0
#: Minimum and maximum pulse width of a hobby servo.
SERVO_PULSES_US = (500, 2500)
LOAD_CELLS = 2
#: Raw load-cell value without a reading since the start of the stream.
NO_READING = -(2**31)


class MessageType(IntEnum):
    """First byte of a packet from the board."""

    FRAME = 0x01
    ACK = 0x02
    IDENTITY = 0x03


class Result(IntEnum):
    """The board's response to a command."""

    OK = 0
    UNKNOWN_COMMAND = 1
    BAD_ARGUMENT = 2
    #: The rate is too high; `Ack.highest_rate_hz` is the highest possible rate.
    TOO_FAST = 3
    #: Not allowed while frames are streamed: send `Stop` first.
    STREAMING = 4
    #: The pixel ceiling has tripped, or (servo) was never armed: send `SetCeiling`.
    TRIPPED = 5


class Contents(IntFlag):
    """Data of a frame in addition to the pixels."""

    PIXELS = 0
    LOAD_CELLS = 1
    PRESSURE = 2
    SERVO = 4


class BoardStatus(IntFlag):
    """Conditions and faults, reported in every frame."""

    #: The previous scan was dropped on the board because the link was too slow.
    DROPPED = 0x01
    #: No command within the heartbeat time: pressure vented, servo held at its position.
    HEARTBEAT_LOST = 0x02
    #: A pixel reached the ceiling: vented, servo opened, safe line low, until `SetCeiling`.
    CEILING_TRIPPED = 0x04
    #: A requested load cell does not answer.
    LOAD_CELL_SILENT = 0x08
    #: The watchdog has reset the board since power-up.
    WATCHDOG_RESET = 0x10
    #: The board received a damaged command since the previous frame.
    COMMAND_DAMAGED = 0x20


@dataclass(frozen=True, slots=True, kw_only=True)
class CellSample:
    """The latest reading of a load-cell amplifier."""

    #: 24-bit signed reading; `NO_READING` before the first.
    raw: int
    #: Number of readings, modulo 256; unchanged if the previous frame had the same reading.
    sample: int


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameMessage:
    """One scan of the pixels, as the board sent it."""

    #: Number of the scan in its stream, from 0; unwrapped from 32 bits.
    sequence: int
    #: Board time at the start of the scan, microseconds; unwrapped from 32 bits within a stream.
    time_us: int
    #: Number of the stream, 1 to 255; changes at each start and each reset of the board.
    stream: int
    #: Conversions summed per pixel.
    oversampling: int
    #: Bits of `BoardStatus`.
    status: int
    #: Shape (rows, cols). Sums of `oversampling` conversions; read-only.
    counts: NDArray[np.uint16]
    #: Empty unless requested.
    load_cells: tuple[CellSample, ...] = ()
    #: Present setpoint (on the ramp) and measured pressure of the regulator; None unless requested.
    pressure_set_kpa: float | None = None
    pressure_kpa: float | None = None
    #: Present pulse width of the servo (on the ramp), 0 without pulses; None unless requested.
    servo_us: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """The board's answer to a command."""

    #: `kind` of the answered command, as received.
    command: int
    #: Tag of the answered command, 0 to 255.
    tag: int
    #: Result of the command.
    result: Result
    #: All frames of this stream below `next_sequence` were sent or dropped before this answer.
    #: Stream 0: no stream since the board started.
    stream: int = 0
    next_sequence: int = 0
    #: Board time, 32 bits.
    time_us: int = 0
    #: Highest frame rate with the present (or just refused) layout, oversampling and contents.
    highest_rate_hz: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardIdentity:
    """The board's description of itself, sent at startup (tag 0) and on `Identify`.

    `rows`, `cols`, `oversampling`, `settle_us`: present configuration.
    """

    #: Tag of the command; 0 if not requested.
    tag: int
    #: `PROTOCOL_VERSION` of the board.
    protocol: int
    #: Firmware version.
    version: tuple[int, int, int]
    #: Bits of `Contents` that the board can send.
    features: int
    rows: int
    cols: int
    oversampling: int
    #: Limits of the configuration.
    max_rows: int
    max_cols: int
    max_oversampling: int
    settle_us: int
    #: Time without commands after which the pressure is vented, or the servo held.
    heartbeat_ms: int
    #: Bits of the ATmega's MCUSR: power-on, reset pin, brown-out, watchdog (8), JTAG.
    reset_cause: int
    #: Whether the board is sending frames.
    streaming: bool
    #: Nominal time of one conversion, and baud rate of the link.
    conversion_us: int
    baud: int
    #: Present frame rate, and highest possible rate with this configuration.
    rate_hz: float
    highest_rate_hz: float
    #: Name of the hardware.
    board: str
    #: Counts of the converter at the supply voltage.
    full_scale: int = 1024


BoardMessage = FrameMessage | Ack | BoardIdentity


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """A packet from the host."""

    #: First byte of its packet.
    kind: ClassVar[int]
    #: `struct` format of the fields after the tag; float fields are sent in thousandths.
    struct_format: ClassVar[str] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identify(Command):
    """Ask for the `BoardIdentity`."""

    kind: ClassVar[int] = 0x81


@dataclass(frozen=True, slots=True, kw_only=True)
class SetLayout(Command):
    """Set the size of the matrix, and the settle time after each multiplexer step."""

    kind: ClassVar[int] = 0x82
    struct_format: ClassVar[str] = "BBH"
    rows: int
    cols: int
    settle_us: int = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SetRate(Command):
    """Set the frame rate; the refusal of a high rate contains the highest possible rate."""

    kind: ClassVar[int] = 0x83
    struct_format: ClassVar[str] = "I"
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SetOversampling(Command):
    """Set the number of conversions summed per pixel, 1 to 64."""

    kind: ClassVar[int] = 0x84
    struct_format: ClassVar[str] = "B"
    conversions: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Start(Command):
    """Start a new stream of frames."""

    kind: ClassVar[int] = 0x85
    struct_format: ClassVar[str] = "B"
    contents: Contents = Contents.PIXELS


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop(Command):
    """End the stream; `next_sequence` of the answer is the number of frames in the stream."""

    kind: ClassVar[int] = 0x86


@dataclass(frozen=True, slots=True, kw_only=True)
class Ping(Command):
    """Request an answer, as a heartbeat; every valid command also counts as one."""

    kind: ClassVar[int] = 0x87


@dataclass(frozen=True, slots=True, kw_only=True)
class SetPressure(Command):
    """Set the regulator's pressure, 0 to 50 kPa, and its rate of change."""

    kind: ClassVar[int] = 0x88
    struct_format: ClassVar[str] = "HI"
    target_kpa: float
    slew_kpa_per_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCeiling(Command):
    """Set the ceiling in counts per conversion, below the full scale; 0 disables it."""

    kind: ClassVar[int] = 0x89
    struct_format: ClassVar[str] = "H"
    counts: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SetServoTravel(Command):
    """Set the pulse widths for open and closed fingers, 500 to 2500 microseconds."""

    kind: ClassVar[int] = 0x8A
    struct_format: ClassVar[str] = "HH"
    open_us: int
    closed_us: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SetServo(Command):
    """Ramp the servo to a pulse width within its travel; 0 stops it."""

    kind: ClassVar[int] = 0x8B
    struct_format: ClassVar[str] = "HH"
    target_us: int
    rate_us_per_s: int
