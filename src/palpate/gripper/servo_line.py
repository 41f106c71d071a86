"""Access to the registers of one servo on a serial line, with retries."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import cycle
from typing import Any

from palpate.errors import DeviceError, DeviceTimeoutError, InputError, require_extra
from palpate.gripper.packets import PROTOCOL_2, PacketLayout, Register, RegisterBlock
from palpate.gripper.settings import check_number
from palpate.gripper.x_series import PacketError
from palpate.sensor.byte_stream import explain_refusal
from palpate.sensor.exclusive_port import claim_port, release_port

#: Errors of a port that was pulled; `termios` exists only on some platforms.
PORT_ERRORS: tuple[type[Exception], ...] = (OSError,)
if sys.platform != "win32":
    try:
        import termios
    except ImportError:
        pass
    else:
        PORT_ERRORS = (OSError, termios.error)

#: Attempts per request, to tolerate single lost or damaged packets.
_TRIES = 3
#: Default time limit for a reply. The adapter can delay bytes by up to 16 ms.
REPLY_S = 0.2
#: Range of this limit: a reply takes a few milliseconds, and three tries must end before the
#: fingers have closed.
_MIN_REPLY_S, _MAX_REPLY_S = 0.005, 2.0
#: Longest single wait for bytes. Without it the SDK polls the port and keeps a processor busy.
_WAIT_S = 0.002
#: Looks at the received bytes after the time limit, enough for a reply between other bytes.
_LATE_LOOKS = 16
#: Sizes of the reads that separate late replies from the next reply, bytes. They are used in turn,
#: and no other request uses them.
_SYNC_SIZES = tuple(range(32, 48))
#: Instructions, of both protocols.
_PING, _READ, _WRITE, _REBOOT = 0x01, 0x02, 0x03, 0x08


class RefusedError(DeviceError):
    """The servo answered and refused the request."""

    def __init__(self, message: str, *, code: int) -> None:
        super().__init__(message)
        self.code = code


class ServoLine:
    """Communicates with one servo through the official SDK, with the port locked.

    `port`: device, e.g. ``"/dev/ttyUSB0"``.
    `reply_s`: time limit for each reply; a busy machine needs more.
    Raises `InputError` if a number is out of range; `MissingExtraError` if dynamixel-sdk is not
    installed; `DeviceNotFoundError` if there is no such port; `DeviceError` if another program uses
    the port.
    """

    def __init__(
        self,
        port: str,
        *,
        servo_id: int,
        baud: int,
        reply_s: float = REPLY_S,
        packets: PacketLayout = PROTOCOL_2,
    ) -> None:
        # A larger number is the broadcast: every servo on the line would obey.
        check_number("servo_id", servo_id, low=0, high=packets.max_id, whole=True)
        check_number("reply_s", reply_s, low=_MIN_REPLY_S, high=_MAX_REPLY_S, unit="s")
        if baud not in packets.bauds:
            raise InputError(f"baud {baud}: must be one of {', '.join(map(str, packets.bauds))}")
        with require_extra("a gripper on a servo line", extra="gripper"):
            import dynamixel_sdk as sdk
        self._sdk = sdk
        self.name = f"servo {servo_id} on {port}"
        #: State bits of the servo's last reply; nonzero after a hardware error.
        self.alert_bits = 0
        self._id, self._layout = servo_id, packets
        self._lock = threading.Lock()
        #: Whether replies to earlier requests can still arrive.
        self._has_late_replies, self._sync_sizes = False, cycle(_SYNC_SIZES)
        self._reply_ms, self._late_looks = 1e3 * reply_s, 0
        self._port: Any = sdk.PortHandler(port)
        # The SDK's own timeout of 34 ms is too short on a busy machine, its clock can be set, and
        # it gives up without a last look at the received bytes.
        self._port.setPacketTimeout = self._set_reply_timeout
        self._port.getCurrentTime = lambda: 1e3 * time.monotonic()
        self._port.isPacketTimeout = self._is_reply_overdue
        self._port.readPort = self._read_port
        self._packets: Any = sdk.PacketHandler(packets.version)
        fast = (False,) if packets is PROTOCOL_2 else ()
        self._receive: Any = lambda: self._packets.rxPacket(self._port, *fast)
        try:
            self._port.setBaudRate(baud)
            # By default the SDK shares the port, and two programs would mix their replies.
            self._port.ser.exclusive = True
            self._port.ser.timeout = _WAIT_S
        except OSError as error:
            # Without `close`, which would undo the claim of the program that uses the port.
            if self._port.is_open:
                self._port.closePort()
            raise explain_refusal(port, error) from error
        if os.name == "posix":
            claim_port(self._port.ser.fileno())

    def ping(self) -> int:
        """Return the servo's model number; 0 if the protocol does not transmit it."""
        reply = self._exchange(_PING, b"", answer_size=self._layout.model_bytes)
        return int.from_bytes(reply[:2], "little")

    def read(self, register: Register) -> int:
        """Return the value of a register."""
        return self.read_block(register.address, register.size).value(register)

    def read_block(self, start: int, size: int) -> RegisterBlock:
        """Return `size` bytes of the control table, from address `start`."""
        encode = self._layout.encode_word
        data = self._exchange(_READ, encode(start) + encode(size), answer_size=size)
        return RegisterBlock(start, data)

    def write(self, register: Register, value: int) -> None:
        """Write a register.

        Raises `RefusedError` if the servo refuses the value.
        """
        self.write_block({register: value})

    def write_block(self, values: Mapping[Register, int]) -> None:
        """Write adjacent registers, in the order of their addresses, in one packet.

        Raises `RefusedError` if the servo refuses a value.
        """
        data = b"".join(register.encode(value) for register, value in values.items())
        start = next(iter(values)).address
        self._exchange(_WRITE, self._layout.encode_word(start) + data, answer_size=0)

    def confirm(self, expected: Mapping[Register, int]) -> None:
        """Read registers back, in one packet.

        Raises `DeviceError` if a register does not have its expected value.
        """
        start = min(register.address for register in expected)
        size = max(register.address + register.size for register in expected) - start
        # A size that is used to separate replies can't be used for anything else.
        block = self.read_block(start, _SYNC_SIZES[-1] + 1 if size in _SYNC_SIZES else size)
        for register, value in expected.items():
            found = block.value(register)
            if found != value:
                raise DeviceError(
                    f"{self.name} has {found} at address {register.address} after it was set to "
                    f"{value}; check that no other program uses the servo, and its firmware"
                )

    def write_without_reply(self, register: Register, value: int) -> None:
        """Write a register of a servo that does not answer, without waiting for a reply."""
        data = self._layout.encode_word(register.address) + register.encode(value)
        with self._lock, self._convert_port_errors():
            self._send(self._layout.build_request(self._id, _WRITE, data))

    def reboot(self) -> None:
        """Restart the servo without torque; only this clears a hardware error."""
        self._exchange(_REBOOT, b"", answer_size=0)

    def close(self) -> None:
        """Close the port; calling it again does nothing."""
        if self._port.is_open:
            if os.name == "posix":
                release_port(self._port.ser.fileno())
            self._port.closePort()

    def _exchange(self, instruction: int, data: bytes, *, answer_size: int) -> bytes:
        """Send a request and return its answer; retry after line errors.

        Threads take turns, so that a guard can stop the servo during a movement.
        """
        with self._lock:
            return self._exchange_alone(instruction, data, answer_size=answer_size)

    def _exchange_alone(self, instruction: int, data: bytes, *, answer_size: int) -> bytes:
        layout, is_silent, is_damaged = self._layout, True, False
        success = self._sdk.COMM_SUCCESS
        for _ in range(_TRIES):
            packet = layout.build_request(self._id, instruction, data)
            with self._convert_port_errors():
                result = self._drop_late_replies() if self._has_late_replies else success
                if result == success:
                    reply, result, error = self._packets.txRxPacket(self._port, packet)
                elif instruction != _READ:
                    self._send(packet)  # commands are not delayed by late replies
            is_silent = is_silent and result == self._sdk.COMM_RX_TIMEOUT
            is_damaged = is_damaged or self._is_damaged(result)
            is_complete = result == success
            if is_complete and layout.is_reply_from(reply, servo_id=self._id, size=answer_size):
                self.alert_bits, code = error & layout.alert_mask, error & ~layout.alert_mask
                if code:
                    raise RefusedError(f"{self.name} refused: {_describe_error(code)}", code=code)
                return bytes(reply[layout.data_offset : layout.data_offset + answer_size])
            self._has_late_replies = True
        if is_damaged:
            raise DeviceError(
                f"{self.name}: replies are damaged ({_TRIES} tries): check the cable, and that no "
                "two servos have the same number"
            )
        if is_silent:
            raise DeviceTimeoutError(
                f"{self.name} does not reply ({_TRIES} tries): check its power, cable, number and "
                "baud rate"
            )
        raise DeviceTimeoutError(
            f"{self.name}: replies are late or incomplete ({_TRIES} tries): check the cable, and "
            "reply_s in the rig file"
        )

    def _is_damaged(self, result: int) -> bool:
        """Return whether an exchange failed for a reason other than time.

        The SDK reports a reply truncated by a timeout as corrupt, and sets its timeout to 0.
        """
        if result in (self._sdk.COMM_SUCCESS, self._sdk.COMM_RX_TIMEOUT):
            return False
        is_truncated = result == self._sdk.COMM_RX_CORRUPT and not self._port.packet_timeout
        return not is_truncated

    def _drop_late_replies(self) -> int:
        """Send a read with a unique size, and drop all replies before its reply.

        Replies do not identify their request, but arrive in the order of the requests. After the
        reply with the unique size, no reply to an earlier request can arrive, however late.
        Returns the SDK's result.
        """
        layout, size = self._layout, next(self._sync_sizes)
        addressed = layout.encode_word(0) + layout.encode_word(size)
        self._send(layout.build_request(self._id, _READ, addressed))
        self._set_reply_timeout(size)
        result: int = self._sdk.COMM_SUCCESS
        while self._has_late_replies and result == self._sdk.COMM_SUCCESS:
            reply, result = self._receive()
            if result == self._sdk.COMM_SUCCESS:
                self._has_late_replies = not (
                    layout.is_reply_from(reply, servo_id=self._id, size=size)
                    and not reply[layout.error_offset] & ~layout.alert_mask
                )
        return result

    def _send(self, packet: list[int]) -> None:
        """Send a packet without waiting for its reply."""
        self._has_late_replies = True
        self._packets.txPacket(self._port, packet)
        self._port.is_using = False

    def _set_reply_timeout(self, size: int) -> None:
        self._late_looks = _LATE_LOOKS
        self._port.setPacketTimeoutMillis(self._reply_ms + size * self._port.tx_time_per_byte)

    def _is_late(self) -> bool:
        return bool(self._port.getTimeSinceStart() > self._port.packet_timeout)

    def _read_port(self, size: int) -> bytes:
        """Read bytes; none once the time is over and enough looks were made.

        Otherwise a device that sends without pause would keep the SDK reading for ever.
        """
        if self._is_late():
            if not self._late_looks:
                return b""
            self._late_looks -= 1
        return bytes(self._port.ser.read(size))

    def _is_reply_overdue(self) -> bool:
        """Return whether the time is over and all received bytes have been looked at.

        This process may not have run for longer than the limit, while the reply arrived in time.
        """
        if not self._is_late() or (self._late_looks and self._port.getBytesAvailable()):
            return False
        # Distinguishes a reply that was cut off by the time limit from a damaged one.
        self._port.packet_timeout = 0
        return True

    @contextmanager
    def _convert_port_errors(self) -> Iterator[None]:
        try:
            yield
        except PORT_ERRORS as error:
            self._port.is_using = False
            raise DeviceError(
                f"{self.name}: the port is gone; plug the adapter in again and check the servo's "
                "power"
            ) from error


def _describe_error(code: int) -> str:
    try:
        return PacketError(code).name.lower().replace("_", " ")
    except ValueError:
        return f"error {code}"
