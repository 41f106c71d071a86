"""A claimed port can't be opened by a second program of the same user."""

from __future__ import annotations

import errno
import os
import subprocess
import sys

from palpate.sensor.exclusive_port import claim_port, release_port

#: Opens a port as a program without privileges; the system never refuses it to root.
_OPEN = (
    "import os, sys\n"
    "if os.getuid() == 0: os.setuid(65534)\n"
    "try: os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)\n"
    "except OSError as error: sys.exit(error.errno)\n"
)


def _open_elsewhere(port: str) -> int:
    return subprocess.run([sys.executable, "-S", "-c", _OPEN, port], check=False).returncode


def test_claimed_port_is_busy_for_others_until_it_is_released() -> None:
    master, slave = os.openpty()
    os.chmod(os.ttyname(slave), 0o666)
    claim_port(slave)
    busy = _open_elsewhere(os.ttyname(slave))
    release_port(slave)
    free = _open_elsewhere(os.ttyname(slave))
    for end in (master, slave):
        os.close(end)
    assert (busy, free) == (errno.EBUSY, 0)


def test_claim_of_something_else_than_a_terminal_does_nothing() -> None:
    reading, writing = os.pipe()
    claim_port(reading)
    for end in (reading, writing):
        os.close(end)
    claim_port(reading)
