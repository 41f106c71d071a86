"""One servo on a DYNAMIXEL line: registers read and written, retried, every failure one line."""

from __future__ import annotations

import termios
from collections.abc import Callable
from typing import Any

from palpate.errors import DeviceError, DeviceNotFoundError, DeviceTimeoutError, needing
from palpate.gripper.x_series import ALERT, HARDWARE_ERROR, HardwareError, PacketError, Register

#: A packet that is lost or damaged once is asked for again; a servo that is gone stays silent.
_TRIES = 3
#: How long a reply may take by default: the adapter holds bytes back for up to 16 ms.
REPLY_S = 0.05
_PROTOCOL = 2.0


class RefusedError(DeviceError):
    """The servo answered, and would not do it."""

    def __init__(self, message: str, *, code: int) -> None:
        super().__init__(message)
        self.code = code


class ServoLine:
    """Speaks Protocol 2.0 with one servo through the official SDK.

    Parameters
    ----------
    port : str
        Device, e.g. ``"/dev/ttyUSB0"``.
    servo_id : int
        Its number on the line.
    baud : int
        Speed of the line.
    reply_s : float
        How long each reply may take; more on a machine that is busy with other things.

    Raises
    ------
    MissingExtraError
        If dynamixel-sdk is not installed.
    DeviceNotFoundError
        If there is no such port.
    """

    def __init__(self, port: str, *, servo_id: int, baud: int, reply_s: float = REPLY_S) -> None:
        with needing("a DYNAMIXEL gripper", extra="gripper"):
            import dynamixel_sdk as sdk
        self._sdk = sdk
        self.name = f"servo {servo_id} on {port}"
        #: Whether the last reply said that there is a hardware error.
        self.alerted = False
        self._id = servo_id
        self._reply_ms = 1e3 * reply_s
        self._port: Any = sdk.PortHandler(port)
        # The SDK's own 34 ms are too few on a busy machine.
        self._port.setPacketTimeout = self._allow_reply
        self._packets: Any = sdk.PacketHandler(_PROTOCOL)
        try:
            opened = self._port.setBaudRate(baud)
        except OSError as error:
            raise DeviceNotFoundError(
                f"port {port} can't be opened: {error.strerror or error}. `palpate ports` lists "
                "those there are; check cable and permissions."
            ) from error
        if not opened:
            raise DeviceError(f"{port}: the servo line can't run at {baud} baud")

    def ping(self) -> int:
        """Return the servo's model number."""
        return int(self._asked(self._packets.ping)[0])

    def read(self, register: Register) -> int:
        """Return the value of a register."""
        return value_at(self.read_run(register.address, register.size), register, register.address)

    def read_run(self, address: int, size: int) -> bytes:
        """Return `size` bytes of the control table from `address` on."""
        return bytes(self._asked(self._packets.readTxRx, address, size)[0])

    def write(self, register: Register, value: int) -> None:
        """Write a register.

        Raises
        ------
        RefusedError
            If the servo would not take it.
        """
        data = value.to_bytes(register.size, "little", signed=value < 0)
        # The SDK takes lists of bytes, and changes them.
        self._asked(self._packets.writeTxRx, register.address, register.size, list(data))

    def reboot(self) -> None:
        """Restart the servo: the only way to clear a hardware error. Its torque is off then."""
        self._asked(self._packets.reboot)

    def errors(self) -> HardwareError:
        """Return the hardware errors; none is 0."""
        return HardwareError(self.read(HARDWARE_ERROR))

    def close(self) -> None:
        """Let go of the port; calling it again does nothing."""
        if self._port.is_open:
            self._port.closePort()

    def _asked(self, exchange: Callable[..., tuple[Any, ...]], *arguments: Any) -> tuple[Any, ...]:
        """Make one exchange, again if it failed on the line; return what it gave."""
        result = 0
        for _ in range(_TRIES):
            *given, result, error = self._exchanged(exchange, *arguments)
            if result == self._sdk.COMM_SUCCESS:
                self.alerted, code = bool(error & ALERT), error & ~ALERT
                if code:
                    raise RefusedError(f"{self.name} refused: {_reason(code)}", code=code)
                return tuple(given)
        if result == self._sdk.COMM_RX_CORRUPT:
            raise DeviceError(
                f"{self.name}: replies are damaged ({_TRIES} tries): check the cable, and that no "
                "two servos share a number"
            )
        raise DeviceTimeoutError(
            f"{self.name} does not reply ({_TRIES} tries): check its power, cable, number and baud"
        )

    def _allow_reply(self, size: int) -> None:
        self._port.setPacketTimeoutMillis(self._reply_ms + size * self._port.tx_time_per_byte)

    def _exchanged(self, exchange: Callable[..., Any], *arguments: Any) -> tuple[Any, ...]:
        try:
            return tuple(exchange(self._port, self._id, *arguments))
        except (OSError, termios.error) as error:
            self._port.is_using = False
            raise DeviceError(
                f"{self.name}: the port is gone; plug it in again and check the servo's power"
            ) from error


def value_at(run: bytes, register: Register, begin: int) -> int:
    """Return the value of a register from a run of the control table that begins at `begin`."""
    at = register.address - begin
    return int.from_bytes(run[at : at + register.size], "little", signed=register.signed)


def _reason(code: int) -> str:
    try:
        return PacketError(code).name.lower().replace("_", " ")
    except ValueError:
        return f"error {code}"
