"""Exclusive use of an open serial port, against programs that ignore its lock."""

from __future__ import annotations

import sys
from contextlib import suppress


def claim_port(descriptor: int) -> None:
    """Let the system refuse any other opening of a port (`TIOCEXCL`) until it is released.

    A lock on the port stops only programs that ask for it; a terminal program does not. Root can
    still open the port. Platforms without this request, such as Windows, open ports exclusively.
    """
    _request("TIOCEXCL", descriptor)


def release_port(descriptor: int) -> None:
    """Undo `claim_port`; call it before closing.

    A real port loses the claim when it is closed, a pseudo-terminal does not.
    """
    _request("TIOCNXCL", descriptor)


def _request(name: str, descriptor: int) -> None:
    if sys.platform != "win32":
        try:
            import fcntl
            import termios
        except ImportError:
            return
        # A descriptor that is not a terminal, or whose adapter was pulled, has nothing to claim.
        with suppress(OSError):
            fcntl.ioctl(descriptor, getattr(termios, name))
