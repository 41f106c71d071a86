"""The board that a gripper shares with the sensor."""

from __future__ import annotations

from typing import Protocol

from palpate.sensor.wire_messages import Command, FrameMessage

#: A sign of life well within the board's heartbeat of 0.5 s.
PING_S = 0.1
#: A frame older than this shows nothing of now.
STALE_S = 0.5


class SharedBoard(Protocol):
    """Interface of the board: its newest frame, and commands to it."""

    def newest(self) -> FrameMessage | None:
        """Return the newest frame as the board sent it."""
        ...

    @property
    def newest_s(self) -> float:
        """Time of that frame on the host's clock."""
        ...

    def send(self, command: Command) -> None:
        """Send a command without waiting for its answer."""
        ...
