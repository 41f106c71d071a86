"""The latency timer of USB serial adapters on Linux, which delays short replies."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

#: Longest latency without a message, ms. At 250 Hz a frame takes 4 ms; the kernel's default for
#: FTDI chips is 16 ms.
LONGEST_MS = 4


def latency_timer_ms(port: str, *, sysfs: Path = Path("/sys")) -> int | None:
    """Return the latency timer of a port's adapter; None if it has none.

    The adapter holds received bytes until the timer ends or its buffer is full. Boards with their
    own USB, and systems other than Linux, show no timer.

    `port`: device or a link to it, such as ``/dev/serial/by-id/...``.
    `sysfs`: root of the kernel's device files.
    """
    try:
        return int(_timer_path(port, sysfs=sysfs).read_text(encoding="ascii"))
    except (OSError, ValueError):
        return None


def explain_latency(port: str, *, sysfs: Path = Path("/sys")) -> str | None:
    """Return one line with the latency and its remedy; None if it is short.

    >>> print(explain_latency("/dev/ttyACM0", sysfs=Path("no-such-folder")))
    None
    """
    latency_ms = latency_timer_ms(port, sysfs=sysfs)
    if latency_ms is None or latency_ms <= LONGEST_MS:
        return None
    return (
        f"{port}: the USB adapter delays bytes by up to {latency_ms} ms; "
        f"`echo 1 | sudo tee {_timer_path(port, sysfs=sysfs)}` sets 1 ms until it is unplugged"
    )


def explain_latencies(ports: Iterable[str], *, sysfs: Path = Path("/sys")) -> list[str]:
    """Return the lines of `explain_latency` for several ports, without repetitions."""
    found = (explain_latency(port, sysfs=sysfs) for port in ports)
    return list(dict.fromkeys(filter(None, found)))


def _timer_path(port: str, *, sysfs: Path) -> Path:
    device = os.path.basename(os.path.realpath(port))
    return sysfs / "bus" / "usb-serial" / "devices" / device / "latency_timer"
