"""A simulated board with a pressure regulator for simulated soft fingers.

The board implements the protocol of `docs/protocol.md`, with slew, heartbeat and read-back. Unlike
the real firmware on the AVR simulator (`palpate.twin.firmware`), it needs no toolchain.
"""

from __future__ import annotations

import math
import struct

from palpate.errors import DeviceError
from palpate.sensor.wire import unpack
from palpate.sensor.wire_messages import (
    MAX_PRESSURE_KPA,
    Ack,
    BoardIdentity,
    BoardStatus,
    Contents,
    FrameMessage,
    Identify,
    Result,
    SetPressure,
    SetRate,
    Start,
    Stop,
)
from palpate.twin.world import World
from palpate_studies.board_bytes import encode_message

_STEP_S = 0.01
_HEARTBEAT_S = 0.5
#: Time constants of the valve, and of fingers without supply.
_LAG_S, _LEAK_S = 0.05, 0.2
#: Smallest change of pressure that moves the fingers.
_MOVES_KPA = 0.02


class RegulatorBoard:
    """A `ByteStream` to the simulated board; each call runs it up to the world's clock.

    Parameters
    ----------
    world : World
        Soft fingers and their pixels, moved only by this board.

    Attributes
    ----------
    pressure_kpa : float
        Present pressure in the fingers.
    vented_s : float
        Time at which the board last started to vent, by command or on its own; -inf before.
    """

    name = "simulated board"

    def __init__(self, world: World) -> None:
        self.world = world
        self._now_s = self._last_packet_s = world.clock.now_s()
        self._out, self._pending = bytearray(), b""
        self._unplugged = self._cut = self._lost = self._silent = False
        self._contents, self._period_s = Contents.PIXELS, 1 / world.frame_rate_hz
        self._stream, self._sequence, self._next_s = 0, 0, math.inf
        self._target_kpa = self._slew = self._output_kpa = self.pressure_kpa = 0.0
        self._driven_kpa = 0.0
        self.vented_s = -math.inf

    def cut_supply(self) -> None:
        """Remove the air supply, so that the fingers empty at any setpoint."""
        self._cut = True

    def silence(self) -> None:
        """Stop sending frames; commands are still executed."""
        self._silent = True

    def unplug(self) -> None:
        """Disconnect the port."""
        self._unplugged = True

    def read_waiting(self) -> bytes:
        """Return all bytes sent since the last call."""
        self.run()
        data = bytes(self._out)
        self._out.clear()
        return data

    def write(self, data: bytes) -> None:
        """Send `data` to the board."""
        self.run()
        *packets, self._pending = (self._pending + data).split(b"\0")
        for packet in packets:
            command = unpack(packet)
            if command is not None:
                self._last_packet_s = self._now_s
                self._execute(*command)

    def close(self) -> None:
        """Release the port; calling it again does nothing."""

    def run(self) -> None:
        """Run up to the world's clock, even if unplugged.

        Raises
        ------
        DeviceError
            If the port was disconnected.
        """
        until_s = self.world.clock.now_s()
        while self._now_s + _STEP_S <= until_s + 1e-9:
            self._now_s += _STEP_S
            self._regulate()
            if self._now_s >= self._next_s and not self._silent:
                self._send_frame()
        if self._unplugged:
            raise DeviceError(f"{self.name} is gone: the cable was pulled")

    def _regulate(self) -> None:
        if (
            self._now_s - self._last_packet_s > _HEARTBEAT_S
            and self._target_kpa + self._output_kpa > 0
        ):
            self._target_kpa = self._output_kpa = 0.0
            self._lost, self.vented_s = True, self._now_s
        step = self._slew * _STEP_S
        self._output_kpa += min(max(self._target_kpa - self._output_kpa, -step), step)
        goal_kpa, time_s = (0.0, _LEAK_S) if self._cut else (self._output_kpa, _LAG_S)
        self.pressure_kpa += (goal_kpa - self.pressure_kpa) * -math.expm1(-_STEP_S / time_s)
        change = abs(self.pressure_kpa - self._driven_kpa)
        if change > _MOVES_KPA:
            self._driven_kpa = self.pressure_kpa
            self.world.drive(self._driven_kpa, rate=change / _STEP_S, time_s=self._now_s)

    def _execute(self, kind: int, payload: bytes) -> None:
        tag, result = payload[0], Result.OK
        if kind == Identify.kind:
            self._out += encode_message(self._identity(tag))
            return
        if kind == SetRate.kind:
            self._period_s = 1e3 / struct.unpack("<I", payload[1:])[0]
        elif kind == Start.kind:
            self._contents = Contents(payload[1])
            self._stream, self._sequence = self._stream % 255 + 1, 0
            self._next_s = self._now_s + self._period_s
        elif kind == Stop.kind:
            self._next_s = math.inf
        elif kind == SetPressure.kind:
            target_pa, slew_pa_per_s = struct.unpack("<HI", payload[1:])
            if target_pa > 1e3 * MAX_PRESSURE_KPA or slew_pa_per_s == 0:
                result = Result.BAD_ARGUMENT
            else:
                if target_pa == 0 and self._target_kpa > 0:
                    self.vented_s = self._now_s
                self._target_kpa, self._slew = target_pa / 1e3, slew_pa_per_s / 1e3
                self._lost = False
        self._out += encode_message(
            Ack(
                command=kind,
                tag=tag,
                result=result,
                stream=self._stream,
                next_sequence=self._sequence,
            )
        )

    def _send_frame(self) -> None:
        pressed = Contents.PRESSURE in self._contents
        frame = FrameMessage(
            sequence=self._sequence,
            time_us=round(1e6 * self._now_s),
            stream=self._stream,
            oversampling=self.world.oversampling,
            status=BoardStatus.HEARTBEAT_LOST if self._lost else BoardStatus(0),
            counts=self.world.scan(self._now_s).astype("uint16"),
            pressure_set_kpa=self._output_kpa if pressed else None,
            pressure_kpa=self.pressure_kpa if pressed else None,
        )
        self._out += encode_message(frame)
        self._sequence += 1
        self._next_s += self._period_s

    def _identity(self, tag: int) -> BoardIdentity:
        layout = self.world.layout
        return BoardIdentity(
            tag=tag,
            protocol=1,
            version=(0, 0, 0),
            features=Contents.PRESSURE,
            rows=layout.rows,
            cols=layout.cols,
            oversampling=self.world.oversampling,
            max_rows=16,
            max_cols=16,
            max_oversampling=64,
            settle_us=20,
            heartbeat_ms=round(1e3 * _HEARTBEAT_S),
            reset_cause=1,
            streaming=self._next_s < math.inf,
            conversion_us=104,
            baud=1_000_000,
            rate_hz=1 / self._period_s,
            highest_rate_hz=1e3,
            board=self.name,
        )
