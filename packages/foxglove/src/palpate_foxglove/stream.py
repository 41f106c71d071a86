"""The readings of `palpate live --foxglove` as messages to Foxglove."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator

from palpate.cli.live_reading import LiveReading
from palpate.cli.options import parse_address
from palpate.clock import Clock
from palpate.recording import Event
from palpate.sensor.array import Frame
from palpate_foxglove import LAYOUT
from palpate_foxglove.channels import Link
from palpate_foxglove.server import FoxgloveServer

#: Time between messages about the link.
_LINK_S = 1.0


class FoxgloveStream:
    """Publishes each frame's reading to Foxglove.

    `clock`: real-time clock, which also stamps a board's frames.
    `address`: HOST:PORT to listen on.
    Raises `InputError` if the address is unusable.
    """

    def __init__(self, reading: LiveReading, *, clock: Clock, address: str) -> None:
        source = reading.source
        host, port = parse_address(address, option="--foxglove")
        self._reading, self._clock = reading, clock
        self._zero_unix_ns = self._wall_zero_unix_ns(clock.now_s())
        self._server = FoxgloveServer(
            host=host,
            port=port,
            name=f"palpate {source.name}" + (" (SIMULATED)" if source.simulated else ""),
            layout=source.array.layout,
            unix_ns=lambda time_s: self._zero_unix_ns + round(time_s * 1e9),
        )
        #: Address to enter in Foxglove, and the layout to import there.
        self.announcement = f"Foxglove at {self._server.address}, layout {LAYOUT}"
        self._touching: frozenset[int] = frozenset()
        self._lost, self._silent = 0, False
        self._next_link_s = -math.inf

    def add(self, frame: Frame | None) -> None:
        """Publish the reading after a frame; None means that no frame arrived."""
        time_s = self._clock.now_s() if frame is None else frame.time_s
        if self._reading.frames == 1 and self._reading.source.simulated:
            # The twin has a separate clock, which is paced to real time from the first frame.
            self._zero_unix_ns = self._wall_zero_unix_ns(time_s)
        for event in self._events(time_s, silent=frame is None):
            self._server.send_recorded(event)
        if frame is not None:
            self._send(frame)
        if time_s >= self._next_link_s:
            self._next_link_s = time_s + _LINK_S
            self._server.send_link(self._link(time_s))

    def close(self) -> None:
        """Stop the server."""
        self._server.close()

    def _send(self, frame: Frame) -> None:
        reading = self._reading
        self._server.send_recorded(frame)
        if reading.source.gripper is not None:
            self._server.send_recorded(reading.source.gripper.state())
        if reading.change_percent is not None:
            self._server.send_change(frame.time_s, reading.change_percent)
        if reading.force_n is not None:
            self._server.send_force(frame.time_s, reading.force_n)

    def _events(self, time_s: float, *, silent: bool) -> Iterator[Event]:
        """Yield new events: contacts, lost frames, silence of the sensor."""
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
            corrupt=reading.source.link_counters().corrupt,
        )

    @staticmethod
    def _wall_zero_unix_ns(time_s: float) -> int:
        """Return the Unix time of 0 s on a clock that now reads `time_s`, ns."""
        return time.time_ns() - round(time_s * 1e9)
