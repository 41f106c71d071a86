"""Messages on the wire: those of the board and the commands of the host.

`docs/protocol.md` is the specification; `palpate.sensor.wire` turns them into bytes and back.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

#: Version 1 has no servo and no full scale in the identity; it is still read.
PROTOCOL_VERSION = 2
MAX_SIDE = 16
MAX_OVERSAMPLING = 64
MAX_PRESSURE_KPA = 50.0
#: Shortest and longest pulse of a hobby servo.
SERVO_PULSES_US = (500, 2500)
LOAD_CELLS = 2
#: Raw load-cell value that means "no reading since the start of the stream".
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
    #: The rate can't be met; `Ack.highest_rate_hz` is the highest that can.
    TOO_FAST = 3
    #: Only possible while no frames are streamed: send `Stop` first.
    STREAMING = 4
    #: The pixel ceiling has tripped, or (servo) was never armed: send `SetCeiling`.
    TRIPPED = 5


class Contents(IntFlag):
    """Data of a frame besides the pixels."""

    PIXELS = 0
    LOAD_CELLS = 1
    PRESSURE = 2
    SERVO = 4


class BoardStatus(IntFlag):
    """Conditions and faults that every frame reports."""

    #: The scan before this one was dropped on the board: the link was too slow.
    DROPPED = 0x01
    #: No command for the heartbeat time: pressure vented, servo held where it was.
    HEARTBEAT_LOST = 0x02
    #: A pixel reached the ceiling; vented, servo opened, safe line low, until `SetCeiling`.
    CEILING_TRIPPED = 0x04
    #: A load cell that was asked for does not answer.
    LOAD_CELL_SILENT = 0x08
    #: The board came back by its watchdog since power-up.
    WATCHDOG_RESET = 0x10
    #: The board received a damaged command since the previous frame.
    COMMAND_DAMAGED = 0x20


@dataclass(frozen=True, slots=True, kw_only=True)
class CellSample:
    """One load-cell amplifier's latest reading."""

    #: 24-bit signed reading; `NO_READING` before the first.
    raw: int
    #: Readings so far, modulo 256: unchanged means the same reading as in the frame before.
    sample: int


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameMessage:
    """One scan of the pixels, as the board sent it."""

    #: Number of the scan in its stream, from 0, without the 32-bit wrap.
    sequence: int
    #: Board time at the start of the scan, microseconds, without the 32-bit wrap within a stream.
    time_us: int
    #: 1 to 255; changes at each start and each reset of the board.
    stream: int
    #: Conversions summed per pixel.
    oversampling: int
    #: Bits of `BoardStatus`.
    status: int
    #: Shape (rows, cols). Sums of 10-bit readings: at most 1023 times `oversampling`; read-only.
    counts: NDArray[np.uint16]
    #: Empty unless asked for.
    load_cells: tuple[CellSample, ...] = ()
    #: Regulator output now (after the slew limit) and its read-back.
    pressure_set_kpa: float | None = None
    pressure_kpa: float | None = None
    #: Width of the servo's pulses now (on the ramp); 0 while there are none.
    servo_us: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Ack:
    """The board's answer to a command."""

    #: `kind` of the command that is answered, as received.
    command: int
    #: The command's own tag, 0 to 255.
    tag: int
    #: What came of it.
    result: Result
    #: Every frame of this stream below `next_sequence` was sent before this answer, or dropped;
    #: stream 0 is none since the board started.
    stream: int = 0
    next_sequence: int = 0
    #: Board time, 32 bits.
    time_us: int = 0
    #: Highest frame rate of the layout, oversampling and contents now in force (or just refused).
    highest_rate_hz: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardIdentity:
    """The board's own description; sent once at start-up (tag 0) and on `Identify`.

    `rows`, `cols`, `oversampling`, `settle_us`: configuration in force.
    """

    #: Tag of the command; 0 when unasked.
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
    #: What it can be set to.
    max_rows: int
    max_cols: int
    max_oversampling: int
    settle_us: int
    #: Silence after which the pressure output is vented.
    heartbeat_ms: int
    #: Bits of the ATmega's MCUSR: power-on, reset pin, brown-out, watchdog (8), JTAG.
    reset_cause: int
    #: Whether frames are being sent.
    streaming: bool
    #: Nominal time of one conversion, and speed of the link.
    conversion_us: int
    baud: int
    #: Frame rate set, and highest possible with this configuration.
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
    #: Of its fields after the tag, as `struct` has it; a quantity goes in thousandths.
    form: ClassVar[str] = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Identify(Command):
    """Ask for the `BoardIdentity`."""

    kind: ClassVar[int] = 0x81


@dataclass(frozen=True, slots=True, kw_only=True)
class SetLayout(Command):
    """Set the size of the matrix, and the wait after each multiplexer step."""

    kind: ClassVar[int] = 0x82
    form: ClassVar[str] = "BBH"
    rows: int
    cols: int
    settle_us: int = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class SetRate(Command):
    """Set the frame rate; refused with the highest possible one if it can't be met."""

    kind: ClassVar[int] = 0x83
    form: ClassVar[str] = "I"
    rate_hz: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SetOversampling(Command):
    """Set the number of conversions summed per pixel, 1 to 64."""

    kind: ClassVar[int] = 0x84
    form: ClassVar[str] = "B"
    conversions: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Start(Command):
    """Begin a new stream of frames."""

    kind: ClassVar[int] = 0x85
    form: ClassVar[str] = "B"
    contents: Contents = Contents.PIXELS


@dataclass(frozen=True, slots=True, kw_only=True)
class Stop(Command):
    """End the stream; the answer's `next_sequence` is the number of its frames."""

    kind: ClassVar[int] = 0x86


@dataclass(frozen=True, slots=True, kw_only=True)
class Ping(Command):
    """Ask for a sign of life; every valid command counts as a heartbeat."""

    kind: ClassVar[int] = 0x87


@dataclass(frozen=True, slots=True, kw_only=True)
class SetPressure(Command):
    """Set the regulator's pressure, 0 to 50 kPa, and how fast to go there."""

    kind: ClassVar[int] = 0x88
    form: ClassVar[str] = "HI"
    target_kpa: float
    slew_kpa_per_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SetCeiling(Command):
    """Set the reading per conversion, 0 to 1023, at which the board vents; 0 disables."""

    kind: ClassVar[int] = 0x89
    form: ClassVar[str] = "H"
    counts: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SetServoTravel(Command):
    """Set the pulse widths for open and closed fingers, 500 to 2500 microseconds."""

    kind: ClassVar[int] = 0x8A
    form: ClassVar[str] = "HH"
    open_us: int
    closed_us: int


@dataclass(frozen=True, slots=True, kw_only=True)
class SetServo(Command):
    """Move the servo to a pulse within its travel, on a ramp; 0 stops it."""

    kind: ClassVar[int] = 0x8B
    form: ClassVar[str] = "HH"
    target_us: int
    rate_us_per_s: int
