"""The far end of a serial pseudo-terminal, in step with a manual clock."""

from __future__ import annotations

import array
import fcntl
import os
import subprocess
import sys
import termios
import tty

#: What the system keeps for a port that nobody reads; a pseudo-terminal's is the same.
BUFFER_BYTES = 4000


#: Opens a port as a program without privileges; the system never refuses it to root.
_OPEN = (
    "import os, sys\n"
    "if os.getuid() == 0: os.setuid(65534)\n"
    "try: os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)\n"
    "except OSError as error: sys.exit(error.errno)\n"
)


def open_elsewhere(port: str) -> int:
    """Open a port in another program; return the number of the error, or 0."""
    return subprocess.run([sys.executable, "-S", "-c", _OPEN, port], check=False).returncode


class PtyPort:
    """What a board sends into, and can pull out."""

    #: Whether `send` waits until the kernel has handed over; not where another thread reads.
    waits = True

    def __init__(self) -> None:
        self.plug()

    def plug(self) -> None:
        self.master, self.slave = os.openpty()
        tty.setraw(self.slave)
        os.set_blocking(self.master, False)
        self.port = os.ttyname(self.slave)

    @property
    def plugged(self) -> bool:
        return self.master >= 0

    def unplug(self) -> None:
        os.close(self.master)
        os.close(self.slave)
        self.master = self.slave = -1

    def waiting(self) -> int:
        count = array.array("i", [0])
        fcntl.ioctl(self.slave, termios.FIONREAD, count)
        return count[0]

    def send(self, data: bytes) -> None:
        before = self.waiting()
        if before + len(data) > BUFFER_BYTES:
            return  # nobody reads: lost, as in a real port
        os.write(self.master, data)
        while self.waits and self.waiting() < before + len(data):
            os.sched_yield()
