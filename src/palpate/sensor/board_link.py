"""Commands to a board and its replies, over a byte stream."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError, WireError
from palpate.sensor.byte_stream import POLL_S, ByteStream
from palpate.sensor.wire import Decoder, encode_command
from palpate.sensor.wire_messages import (
    Ack,
    BoardIdentity,
    Command,
    FrameMessage,
    Identify,
    Result,
    SetRate,
)

#: Opening the port resets most boards, and any received byte keeps a bootloader in programming
#: mode. The host therefore sends nothing until the firmware's first message. The stock bootloader
#: of a Mega takes 0.9 s, or 5.2 s after a received byte (both measured on the simulator). The
#: longer wait applies after a board falls silent, because it may still receive an earlier byte.
LISTEN_S, RESTART_S = 2.0, 6.0
#: Time limit for an answer after that wait.
ANSWER_TIMEOUT_S = 2.0
#: A command without an answer after this time is sent again. The time is that of docs/protocol.md
#: for all baud rates except 9600, where 1 s is recommended.
RESEND_S = 0.3
_FRAME_OVERHEAD_BYTES = 23  # head 13, packet 7, stuffing 2, final zero
_FIRMWARE_S_PER_PIXEL = 10e-6  # docs/protocol.md


class BoardLink:
    """Feeds a decoder from a stream and executes lists of commands without blocking.

    Nothing is sent until the board has sent data or `LISTEN_S` has elapsed.

    `decoder`: decoder of the earlier link, whose counters continue after a reconnect; by default a
        new decoder.
    """

    def __init__(self, stream: ByteStream, *, clock: Clock, decoder: Decoder | None = None) -> None:
        self.stream = stream
        self.decoder = decoder or Decoder()
        self.identity: BoardIdentity | None = None
        #: Whether the board has been reset since its last setup (an unrequested identity arrived).
        self.was_reset = False
        self._clock = clock
        self._commands: Sequence[Command] = ()
        self._pending: list[Command] = []
        self._tag = 0
        self._sent_s = -math.inf
        self._started_s = 0.0
        self._received_bytes = 0
        self._has_packet = False
        self._listen_until_s = clock.now_s() + LISTEN_S

    @property
    def is_busy(self) -> bool:
        """Whether a command is still unanswered."""
        return bool(self._pending)

    def start_commands(self, commands: Sequence[Command]) -> None:
        """Start sending commands, each after the board's reply to the previous one."""
        self._commands = commands
        self._pending = list(commands)
        self.was_reset = False
        self._received_bytes = 0
        self._has_packet = False
        self._prepare_command()

    def wait_for_restart(self) -> None:
        """Send nothing until the board sends a packet, or for `RESTART_S`."""
        self._listen_until_s = self._clock.now_s() + RESTART_S

    def poll(self) -> list[FrameMessage]:
        """Receive bytes and send due commands; return frames once all commands are answered.

        Raises `DeviceError` if the port is lost, or the board refuses or ignores a command.
        """
        data = self.stream.read_waiting()
        self._received_bytes += len(data)
        frames: list[FrameMessage] = []
        for message in self.decoder.feed(data) if data else ():
            self._has_packet = True
            self._listen_until_s = -math.inf
            if isinstance(message, FrameMessage):
                if not self._pending:
                    frames.append(message)
            elif isinstance(message, BoardIdentity):
                self._handle_identity(message)
            else:
                self._handle_answer(message)
        if self._pending:
            self._send_if_due()
        return frames

    def execute(self, *commands: Command) -> list[FrameMessage]:
        """Send commands and wait for their answers; return the frames after the last answer."""
        self.start_commands(commands)
        while True:
            frames = self.poll()
            if not self.is_busy:
                return frames
            self._clock.sleep_s(POLL_S)

    def send(self, command: Command) -> None:
        """Send a command, e.g. a heartbeat or pressure step, without waiting for its answer."""
        self.stream.write(encode_command(command, tag=0))

    def _prepare_command(self) -> None:
        # Tags are 1 to 255, because tag 0 marks an unrequested identity.
        self._tag = self._tag % 255 + 1
        self._started_s = max(self._clock.now_s(), self._listen_until_s)
        self._sent_s = -math.inf

    def _send_if_due(self) -> None:
        now_s = self._clock.now_s()
        if now_s < self._listen_until_s:
            return
        if now_s - self._started_s > ANSWER_TIMEOUT_S:
            raise self._explain_silence()
        if now_s - self._sent_s >= RESEND_S:
            self._sent_s = now_s
            self.stream.write(encode_command(self._pending[0], tag=self._tag))

    def _handle_identity(self, identity: BoardIdentity) -> None:
        self.identity = identity
        if identity.tag == 0 and self._pending:
            self._pending = list(self._commands)  # the board has lost its earlier settings
            self._prepare_command()
        elif identity.tag == 0:
            self.was_reset = True
        elif identity.tag == self._tag and self._pending and isinstance(self._pending[0], Identify):
            self._advance()

    def _handle_answer(self, ack: Ack) -> None:
        if not self._pending or ack.tag != self._tag:
            return
        command = self._pending[0]
        if ack.result == Result.TOO_FAST:
            rate = (
                f"{command.rate_hz:g} frames/s" if isinstance(command, SetRate) else "the set rate"
            )
            raise WireError(
                f"{self.stream.name}: the board does not support {rate} with this layout and "
                f"oversampling; at most {ack.highest_rate_hz:.1f}"
            )
        if ack.result != Result.OK:
            reason = ack.result.name.lower().replace("_", " ")
            raise WireError(f"{self.stream.name}: the board refused {command}: {reason}")
        self._advance()

    def _advance(self) -> None:
        del self._pending[0]
        self._prepare_command()

    def _explain_silence(self) -> DeviceError:
        name, waited_s = self.stream.name, LISTEN_S + ANSWER_TIMEOUT_S
        if self._received_bytes and not self._has_packet:
            return WireError(
                f"{name}: {self._received_bytes} bytes but no valid packet in {waited_s:g} s: "
                "the baud rate differs, or the board runs another program. If it prints numbers, "
                "`palpate init --board text` describes it; `palpate flash` replaces the program"
            )
        if self._has_packet:
            return DeviceTimeoutError(
                f"{name}: the board sends data but does not answer. Close any other program that "
                "uses the port."
            )
        return DeviceTimeoutError(
            f"{name}: no answer from the board in {waited_s:g} s. Check its power, then "
            "flash palpate's firmware with `palpate flash`."
        )


def minimum_delay_s(identity: BoardIdentity, *, pixels: int, oversampling: int) -> float:
    """Return the time from the start of a scan to its last byte.

    `identity`: provides the conversion time, the settle time and the baud rate.
    """
    conversion_s = oversampling * identity.conversion_us * 1e-6
    scan_s = pixels * (identity.settle_us * 1e-6 + conversion_s + _FIRMWARE_S_PER_PIXEL)
    return scan_s + (_FRAME_OVERHEAD_BYTES + 2 * pixels) * 10 / identity.baud
