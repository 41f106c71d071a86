"""A serial port as a stream of bytes, with explanations when it can't be opened."""

from __future__ import annotations

import errno
import os
import select
import sys
import time
from contextlib import suppress
from typing import Protocol

from palpate.errors import DeviceError, DeviceNotFoundError, InputError
from palpate.sensor.exclusive_port import claim_port, release_port

BAUD = 1_000_000
#: Range of a baud rate: the slowest of POSIX (B50), and the bits that full-speed USB transfers.
_LOWEST_BAUD, _HIGHEST_BAUD = 50, 12_000_000
#: Interval between reads of a port, seconds: half of the frame period at 500 Hz.
POLL_S = 0.001
_READ_BYTES = 1 << 16


class ByteStream(Protocol):
    """Bytes to and from a board."""

    @property
    def name(self) -> str:
        """Name for messages, e.g. the port."""
        ...

    def read_waiting(self) -> bytes:
        """Return all received bytes without waiting; b"" if there are none.

        Raises `DeviceError` if the port is lost.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`.

        Raises `DeviceError` if the port is lost.
        """
        ...

    def close(self) -> None:
        """Release the port; calling it again does nothing."""
        ...


class SerialStream:
    """A `ByteStream` over a serial port that no other program can open.

    `port`: device, e.g. ``"/dev/ttyACM0"``.
    `baud`: baud rate of the firmware.
    Raises `InputError` if the baud rate is impossible; `DeviceNotFoundError` if there is no such
    port; `DeviceError` if the port is busy or access is denied.
    """

    def __init__(self, port: str, *, baud: int = BAUD) -> None:
        self.name = port
        if not _LOWEST_BAUD <= baud <= _HIGHEST_BAUD:
            raise InputError(
                f"baud {baud}: must be {_LOWEST_BAUD} to {_HIGHEST_BAUD}, as in the board's program"
            )
        try:
            # Loaded here, so that other sensors work where pyserial doesn't.
            import serial
        except ImportError as error:
            raise DeviceError(f"{port}: no serial ports on this system ({error})") from error
        try:
            self._serial = serial.Serial(port, baud, timeout=0, write_timeout=1.0, exclusive=True)
        except OSError as error:
            raise explain_refusal(port, error) from error
        if sys.platform != "win32":  # Windows opens ports exclusively.
            # The lock stops only programs that ask for it.
            claim_port(self._serial.fileno())

    def read_waiting(self) -> bytes:
        """Return all received bytes without waiting."""
        try:
            return bytes(self._serial.read(_READ_BYTES))
        except OSError as error:
            raise DeviceError(_port_error(self.name)) from error

    def wait_for_bytes(self, timeout_s: float) -> None:
        """Wait until bytes arrive or the port is lost, at most `timeout_s`."""
        try:
            select.select([self._serial.fileno()], [], [], timeout_s)
        except (OSError, ValueError):
            time.sleep(POLL_S)  # no descriptor, as on Windows, or the port is closed

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        try:
            self._serial.write(data)
        except OSError as error:
            raise DeviceError(_port_error(self.name)) from error

    def close(self) -> None:
        """Release the port; calling it again does nothing."""
        if sys.platform != "win32" and self._serial.is_open:
            release_port(self._serial.fileno())
        self._serial.close()


def wait_for_bytes(stream: ByteStream, *, timeout_s: float) -> None:
    """Wait until a stream may have bytes, at most `timeout_s` of real time."""
    if isinstance(stream, SerialStream):
        stream.wait_for_bytes(timeout_s)
    else:
        time.sleep(min(POLL_S, timeout_s))


def _port_error(port: str) -> str:
    return f"{port} is gone: the cable was pulled or the board lost power. Plug the board in again."


def explain_refusal(port: str, error: OSError) -> DeviceError:
    """Return an error with the reason why a port can't be opened, and the remedy."""
    code = error.errno
    # pyserial states only the text of an error in the configuration.
    if code is None and error.__context__ is not None and error.__context__.args:
        code = error.__context__.args[0]
    if code in (errno.ENOTTY, errno.EISDIR):
        return DeviceError(
            f"{port} is not a serial port; `palpate ports` lists the available ports"
        )
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return DeviceNotFoundError(
            f"no port {port or repr(port)}; `palpate ports` lists the available ports. Check "
            "cable and power."
        )
    if code in (errno.EACCES, errno.EPERM):
        return DeviceError(
            f"{port}: permission denied. Run `sudo usermod -aG {_port_group(port)} $USER`, "
            "then log out and in again."
        )
    if code in (errno.EBUSY, errno.EAGAIN):
        return DeviceError(
            f"{port} is in use by another program; `fuser -v {port}` shows which. Close it first."
        )
    return DeviceError(f"{port} can't be opened as a serial port: {error}")


def _port_group(port: str) -> str:
    """Return the user group with access to the port: `dialout` on most systems."""
    if sys.platform != "win32":
        with suppress(ImportError, OSError, KeyError):
            import grp

            name = grp.getgrgid(os.stat(port).st_gid).gr_name
            return "dialout" if name == "root" else name
    return "dialout"
