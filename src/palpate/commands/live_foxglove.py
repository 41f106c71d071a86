"""Messages of `palpate live --foxglove`: each frame and what it means, events, and the link."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from palpate.clock import Clock
from palpate.commands.live_reading import LiveReading
from palpate.errors import InputError
from palpate.foxglove.channels import Link
from palpate.foxglove.server import FoxgloveServer
from palpate.recording import Event
from palpate.sensor.array import Frame

_LINK_S = 1.0


def host_and_port(address: str) -> tuple[str, int]:
    """Split HOST:PORT.

    Raises `InputError` if it is not one.

    >>> host_and_port("[::1]:8765")
    ('::1', 8765)
    """
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise InputError(f"--foxglove {address}: give HOST:PORT, like 127.0.0.1:8765")
    return host.strip("[]"), int(port)


class LiveStream:
    """Sends a reading at every frame.

    `clock`: the clock on the wall; a board's frames are on it too.
    `address`: HOST:PORT to listen at.
    Raises `InputError` if it can't listen there.
    """

    def __init__(self, reading: LiveReading, *, clock: Clock, address: str) -> None:
        source = reading.source
        host, port = host_and_port(address)
        self._reading, self._clock = reading, clock
        self._zero_unix_ns = self._wall_zero_unix_ns(clock.now_s())
        self._server = FoxgloveServer(
            host=host,
            port=port,
            name=f"palpate {source.name}" + (" (SIMULATED)" if source.simulated else ""),
            layout=source.array.layout,
            unix_ns=lambda time_s: self._zero_unix_ns + round(time_s * 1e9),
        )
        #: What to type in Foxglove.
        self.address = self._server.address
        self._touching: frozenset[int] = frozenset()
        self._lost, self._silent = 0, False
        self._next_link_s = -math.inf

    def add(self, frame: Frame | None) -> None:
        """Send what the reading knows since this frame; None where none came for a while."""
        time_s = self._clock.now_s() if frame is None else frame.time_s
        if self._reading.frames == 1 and self._reading.source.simulated:
            # The twin's clock is its own, and is held to the pace of the wall's from here on.
            self._zero_unix_ns = self._wall_zero_unix_ns(time_s)
        for event in self._events(time_s, silent=frame is None):
            self._server.record(event)
        if frame is not None:
            self._send(frame)
        if time_s >= self._next_link_s:
            self._next_link_s = time_s + _LINK_S
            self._server.link(self._link(time_s))

    def close(self) -> None:
        """Send nothing more."""
        self._server.close()

    def _send(self, frame: Frame) -> None:
        reading = self._reading
        self._server.record(frame)
        if reading.source.gripper is not None:
            self._server.record(reading.source.gripper.state())
        if reading.change_percent is not None:
            self._server.change(frame.time_s, reading.change_percent)
        if reading.force_n is not None:
            self._server.force(frame.time_s, reading.force_n)

    def _events(self, time_s: float, *, silent: bool) -> Iterator[Event]:
        """Yield what has changed: touches, losses, silence."""
        reading = self._reading
        if silent != self._silent:
            yield Event(time_s=time_s, name="silent" if silent else "back")
        if reading.lost > self._lost:
            yield Event(time_s=time_s, name="lost", text=f"{reading.lost - self._lost} frames")
        for finger in sorted(reading.touching ^ self._touching):
            name = "contact" if finger in reading.touching else "released"
            yield Event(time_s=time_s, name=name, text=f"finger {finger}")
        self._silent, self._lost, self._touching = silent, reading.lost, reading.touching

    def _link(self, time_s: float) -> Link:
        reading = self._reading
        return Link(
            time_s=time_s,
            source=reading.source.name,
            simulated=reading.source.simulated,
            rate_hz=reading.rate_hz,
            frames=reading.frames,
            lost=reading.lost,
            corrupt=reading.source.events().corrupt,
        )

    @staticmethod
    def _wall_zero_unix_ns(time_s: float) -> int:
        """Return the Unix time at which a clock that now reads `time_s` read 0 s."""
        return time.time_ns() - round(time_s * 1e9)
