"""Commands and answers over a byte stream: one conversation with one board."""

from __future__ import annotations

import math
from collections.abc import Sequence

from palpate.clock import Clock
from palpate.errors import DeviceError, DeviceTimeoutError, WireError
from palpate.sensor.byte_stream import ByteStream
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

#: Opening its port resets most boards, and any byte keeps a boot loader in its programming mode:
#: the firmware's own first message is awaited in silence. The stock boot loader of a Mega takes
#: 0.9 s, and 5.2 s where a byte was on its way to it (both on the simulator): what was being sent
#: to a board that falls silent is such a byte.
LISTEN_S, RESTART_S = 2.0, 6.0
#: After that, an answer is missing from this time on.
ANSWER_TIMEOUT_S = 2.0
#: An answer that has not come by then is lost (docs/protocol.md; 1 s at 9600 baud).
RESEND_S = 0.3
#: Bytes are fetched in bulk this often: a quarter of the time between frames at 500 Hz at most.
POLL_S = 0.001
_FRAME_OVERHEAD_BYTES = 23  # head 13, packet 7, stuffing 2, final zero
_FIRMWARE_S_PER_PIXEL = 10e-6  # docs/protocol.md


class BoardLink:
    """Feeds a decoder from a stream and executes command lists without blocking.

    Nothing is sent until data has arrived from the board, or `LISTEN_S` have passed.

    `decoder`: to continue the count after a reconnect.
    """

    def __init__(self, stream: ByteStream, *, clock: Clock, decoder: Decoder | None = None) -> None:
        self.stream = stream
        self.decoder = decoder or Decoder()
        self.identity: BoardIdentity | None = None
        #: The board started again (an unrequested identity) since it was last set up.
        self.was_reset = False
        self._clock = clock
        self._commands: Sequence[Command] = ()
        self._todo: list[Command] = []
        self._tag = 0
        self._sent_s = -float("inf")
        self._asked_s = 0.0
        self._bytes_seen = 0
        self._heard = False
        self._listen_until_s = clock.now_s() + LISTEN_S

    @property
    def busy(self) -> bool:
        """Whether commands wait for answers."""
        return bool(self._todo)

    def begin(self, commands: Sequence[Command]) -> None:
        """Send these commands one by one, each after the answer to the one before."""
        self._commands = commands
        self._todo = list(commands)
        self.was_reset = False
        self._bytes_seen = 0
        self._heard = False
        self._next_command()

    def listen(self) -> None:
        """Send nothing until the board sends, or for `RESTART_S`: it may be starting."""
        self._listen_until_s = self._clock.now_s() + RESTART_S

    def poll(self) -> list[FrameMessage]:
        """Receive bytes, send due commands; return frames once all commands are answered.

        Raises `DeviceError` if the port is gone, or the board refuses a command or does not answer.
        """
        data = self.stream.read_waiting()
        self._bytes_seen += len(data)
        frames: list[FrameMessage] = []
        for message in self.decoder.feed(data) if data else ():
            self._heard = True
            self._listen_until_s = -math.inf
            if isinstance(message, FrameMessage):
                if not self._todo:
                    frames.append(message)
            elif isinstance(message, BoardIdentity):
                self._identify(message)
            else:
                self._take_answer(message)
        if self._todo:
            self._send_if_due()
        return frames

    def ask(self, *commands: Command) -> list[FrameMessage]:
        """Carry out commands and wait for the answers; return the frames right after the last."""
        self.begin(commands)
        while True:
            frames = self.poll()
            if not self.busy:
                return frames
            self._clock.sleep_s(POLL_S)

    def send(self, command: Command) -> None:
        """Send a command without waiting for its answer (heartbeats, pressure steps)."""
        self.stream.write(encode_command(command, tag=0))

    def _next_command(self) -> None:
        # Tags 1 to 255: an identity with tag 0 was not asked for.
        self._tag = self._tag % 255 + 1
        self._asked_s = max(self._clock.now_s(), self._listen_until_s)
        self._sent_s = -float("inf")

    def _send_if_due(self) -> None:
        now_s = self._clock.now_s()
        if now_s < self._listen_until_s:
            return
        if now_s - self._asked_s > ANSWER_TIMEOUT_S:
            raise self._explain_silence()
        if now_s - self._sent_s >= RESEND_S:
            self._sent_s = now_s
            self.stream.write(encode_command(self._todo[0], tag=self._tag))

    def _identify(self, identity: BoardIdentity) -> None:
        self.identity = identity
        if identity.tag == 0 and self._todo:
            self._todo = list(self._commands)  # the board has lost its earlier settings
            self._next_command()
        elif identity.tag == 0:
            self.was_reset = True
        elif identity.tag == self._tag and self._todo and isinstance(self._todo[0], Identify):
            self._advance()

    def _take_answer(self, ack: Ack) -> None:
        if not self._todo or ack.tag != self._tag:
            return
        if ack.result == Result.TOO_FAST:
            wanted = self._todo[0]
            rate = f"{wanted.rate_hz:g} frames/s" if isinstance(wanted, SetRate) else "the rate set"
            raise WireError(
                f"{self.stream.name}: the board can't do {rate} with this layout and "
                f"oversampling; at most {ack.highest_rate_hz:.1f}"
            )
        if ack.result != Result.OK:
            refusal = ack.result.name.lower().replace("_", " ")
            raise WireError(f"{self.stream.name}: the board refused {self._todo[0]}: {refusal}")
        self._advance()

    def _advance(self) -> None:
        del self._todo[0]
        self._next_command()

    def _explain_silence(self) -> DeviceError:
        name, waited_s = self.stream.name, LISTEN_S + ANSWER_TIMEOUT_S
        if self._bytes_seen and not self._heard:
            return WireError(
                f"{name}: {self._bytes_seen} bytes but no valid packet in {waited_s:g} s: "
                "the baud rate is another, or the board runs other firmware (`palpate flash`)"
            )
        if self._heard:
            return DeviceTimeoutError(
                f"{name}: the board sends but does not answer. Is another program using the port?"
            )
        return DeviceTimeoutError(
            f"{name}: no answer from the board in {waited_s:g} s. Check its power, then "
            "put palpate's firmware on it with `palpate flash`."
        )


def least_delay_s(identity: BoardIdentity, *, pixels: int, oversampling: int) -> float:
    """Return the time from the start of a scan to its last byte.

    `identity`: conversion and settle times, and the speed of the link.
    """
    conversion_s = oversampling * identity.conversion_us * 1e-6
    scan_s = pixels * (identity.settle_us * 1e-6 + conversion_s + _FIRMWARE_S_PER_PIXEL)
    return scan_s + (_FRAME_OVERHEAD_BYTES + 2 * pixels) * 10 / identity.baud
