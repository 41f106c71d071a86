"""One servo on a line: registers read and written, retried, every failure one line."""

from __future__ import annotations

import errno
import termios
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from typing import Any

from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, require_extra
from palpate.gripper.packets import PROTOCOL_2, Packets, Register, RegisterRun
from palpate.gripper.x_series import HARDWARE_ERROR, HardwareError, PacketError

#: A packet that is lost or damaged once is asked for again; a servo that is gone stays silent.
_TRIES = 3
#: How long a reply may take by default: the adapter holds bytes back for up to 16 ms.
REPLY_S = 0.05
#: Sizes of the reads that separate late replies from the next one, in turn, bytes. No other
#: request has one of them.
_MARKS = tuple(range(32, 48))
#: Instructions, of both protocols.
_PING, _READ, _WRITE, _REBOOT = 0x01, 0x02, 0x03, 0x08


class RefusedError(DeviceError):
    """The servo answered, and would not do it."""

    def __init__(self, message: str, *, code: int) -> None:
        super().__init__(message)
        self.code = code


class ServoLine:
    """Speaks with one servo through the official SDK; the port is locked against other programs.

    `port`: device, e.g. ``"/dev/ttyUSB0"``.
    `reply_s`: how long each reply may take; more on a machine that is busy with other work.
    Raises `MissingExtraError` if dynamixel-sdk is not installed; `DeviceNotFoundError` if there is
    no such port; `DeviceError` if another program has locked it.
    """

    def __init__(
        self,
        port: str,
        *,
        servo_id: int,
        baud: int,
        reply_s: float = REPLY_S,
        packets: Packets = PROTOCOL_2,
    ) -> None:
        with require_extra("a gripper on a servo line", extra="gripper"):
            import dynamixel_sdk as sdk
        self._sdk = sdk
        self.name = f"servo {servo_id} on {port}"
        #: The servo's state in its last reply: not 0 means a hardware error.
        self.alerted = 0
        self._id, self._layout = servo_id, packets
        #: Whether replies to earlier questions may still come.
        self._behind, self._marks = False, cycle(_MARKS)
        self._reply_ms = 1e3 * reply_s
        self._port: Any = sdk.PortHandler(port)
        # The SDK's own 34 ms are too few on a busy machine.
        self._port.setPacketTimeout = self._allow_reply
        self._packets: Any = sdk.PacketHandler(packets.version)
        fast = (False,) if packets is PROTOCOL_2 else ()
        self._receive: Any = lambda: self._packets.rxPacket(self._port, *fast)
        try:
            opened = self._port.setBaudRate(baud)
            if opened:
                # The SDK shares the port: two programs would take each other's replies.
                self._port.ser.exclusive = True
        except OSError as error:
            self.close()
            if error.errno in (errno.EAGAIN, errno.EBUSY):
                raise DeviceError(
                    f"{port} is in use by another program; `fuser -v {port}` names it. Close it "
                    "first."
                ) from error
            raise DeviceNotFoundError(
                f"port {port} can't be opened: {error.strerror or error}. `palpate ports` lists "
                "those there are; check cable and permissions."
            ) from error
        if not opened:
            raise DeviceError(f"{port}: the servo line can't run at {baud} baud")

    def ping(self) -> int:
        """Return the servo's model number; 0 where the protocol does not give it."""
        reply = self._ask(_PING, b"", answer=self._layout.model_bytes)
        return int.from_bytes(reply[:2], "little")

    def read(self, register: Register) -> int:
        """Return the value of a register."""
        return self.read_run(register.address, register.size).value(register)

    def read_run(self, begin: int, size: int) -> RegisterRun:
        """Return `size` bytes of the control table from address `begin` on."""
        place = self._layout.place
        return RegisterRun(begin, self._ask(_READ, place(begin) + place(size), answer=size))

    def write(self, register: Register, value: int) -> None:
        """Write a register.

        Raises `RefusedError` if the servo would not take it.
        """
        data = value.to_bytes(register.size, "little", signed=value < 0)
        self._ask(_WRITE, self._layout.place(register.address) + data, answer=0)

    def confirm(self, wanted: Mapping[Register, int]) -> None:
        """Read registers back.

        Raises `DeviceError` if one has another value than `wanted`.
        """
        for register, value in wanted.items():
            found = self.read(register)
            if found != value:
                raise DeviceError(
                    f"{self.name} keeps {found} at address {register.address}, and was set to "
                    f"{value}; check that no other program uses it, and its firmware"
                )

    def write_blindly(self, register: Register, value: int) -> None:
        """Write a register without waiting for an answer: for a servo that does not answer."""
        data = value.to_bytes(register.size, "little", signed=value < 0)
        given = self._layout.place(register.address) + data
        with self._port_there():
            self._send(self._layout.request(self._id, _WRITE, given))

    def reboot(self) -> None:
        """Restart the servo, the only way to clear a hardware error; torque goes off."""
        self._ask(_REBOOT, b"", answer=0)

    def errors(self) -> HardwareError:
        """Return the hardware errors; none is 0."""
        return HardwareError(self.read(HARDWARE_ERROR))

    def close(self) -> None:
        """Close the port; calling it again does nothing."""
        if self._port.is_open:
            self._port.closePort()

    def _ask(self, instruction: int, given: bytes, *, answer: int) -> bytes:
        """Make one exchange, with a retry after line errors; return its `answer` bytes."""
        layout, is_silent, is_damaged = self._layout, True, False
        for _ in range(_TRIES):
            packet = layout.request(self._id, instruction, given)
            with self._port_there():
                if self._behind and (result := self._catch_up()) != self._sdk.COMM_SUCCESS:
                    is_silent = is_silent and result == self._sdk.COMM_RX_TIMEOUT
                    is_damaged = is_damaged or self._is_damaged(result)
                    if instruction != _READ:
                        self._send(packet)  # no order waits for a line that is late
                    continue
                reply, result, error = self._packets.txRxPacket(self._port, packet)
            is_silent = is_silent and result == self._sdk.COMM_RX_TIMEOUT
            is_damaged = is_damaged or self._is_damaged(result)
            whole = result == self._sdk.COMM_SUCCESS
            if whole and layout.answers(reply, number=self._id, size=answer):
                self.alerted, code = error & layout.alert, error & ~layout.alert
                if code:
                    raise RefusedError(f"{self.name} refused: {_reason(code)}", code=code)
                return bytes(reply[layout.data_at : layout.data_at + answer])
            self._behind = True
        if is_damaged:
            raise DeviceError(
                f"{self.name}: replies are damaged ({_TRIES} tries): check the cable, and that no "
                "two servos share a number"
            )
        if is_silent:
            raise DeviceTimeoutError(
                f"{self.name} does not reply ({_TRIES} tries): check its power, cable, number and "
                "baud"
            )
        raise DeviceTimeoutError(
            f"{self.name}: replies are late or incomplete ({_TRIES} tries): check the cable, and "
            "reply_s in the rig file"
        )

    def _is_damaged(self, result: int) -> bool:
        """Return whether an exchange failed for another reason than time.

        The SDK reports a reply that its deadline cut as corrupt, and sets its time-out to 0 then.
        """
        if result in (self._sdk.COMM_SUCCESS, self._sdk.COMM_RX_TIMEOUT):
            return False
        is_cut = result == self._sdk.COMM_RX_CORRUPT and not self._port.packet_timeout
        return not is_cut

    def _catch_up(self) -> int:
        """Ask what only this question's reply can be, and drop all that comes before it.

        Replies carry no number of their question, but come in its order: once the one of this size
        is here, none of an earlier question can come any more, however late they are.
        Returns the SDK's result.
        """
        layout, size = self._layout, next(self._marks)
        self._send(layout.request(self._id, _READ, layout.place(0) + layout.place(size)))
        self._allow_reply(size)
        result: int = self._sdk.COMM_SUCCESS
        while self._behind and result == self._sdk.COMM_SUCCESS:
            reply, result = self._receive()
            if result == self._sdk.COMM_SUCCESS:
                self._behind = not (
                    layout.answers(reply, number=self._id, size=size)
                    and not reply[layout.error_at] & ~layout.alert
                )
        return result

    def _send(self, packet: list[int]) -> None:
        """Send a packet whose reply is not waited for here."""
        self._behind = True
        self._packets.txPacket(self._port, packet)
        self._port.is_using = False

    def _allow_reply(self, size: int) -> None:
        self._port.setPacketTimeoutMillis(self._reply_ms + size * self._port.tx_time_per_byte)

    @contextmanager
    def _port_there(self) -> Iterator[None]:
        try:
            yield
        except (OSError, termios.error) as error:
            self._port.is_using = False
            raise DeviceError(
                f"{self.name}: the port is gone; plug it in again and check the servo's power"
            ) from error


def _reason(code: int) -> str:
    try:
        return PacketError(code).name.lower().replace("_", " ")
    except ValueError:
        return f"error {code}"
