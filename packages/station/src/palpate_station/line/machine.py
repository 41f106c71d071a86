"""The interface between a station and the line protocols: state, result and commands."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Protocol

from palpate.grasp.document import GraspDocument


class LineState(IntEnum):
    """States of a station, a subset modelled on PackML (ISA-TR88.00.02)."""

    #: No rig is open, frames are stale, or the hand is not open (release first).
    STOPPED = 0
    #: Ready for a grasp.
    IDLE = 1
    #: A grasp is running.
    EXECUTE = 2
    #: The object is held and measured; release it.
    HOLDING = 3
    #: The devices are lost or report a fault.
    ABORTED = 4


class Machine(Protocol):
    """The server's interface for a protocol, called on the protocols' event loop.

    Commands raise `CommandRefusedError` if they can't be executed now and `InputError` for an
    invalid value.
    """

    def state(self) -> Mapping[str, Any]:
        """Return the state document (docs/schemas/state.json)."""
        ...

    def result(self) -> tuple[int, GraspDocument | None]:
        """Return the number of grasps finished in this run and the last grasp document."""
        ...

    async def grasp(
        self,
        driver: str,
        *,
        target_force_n: float | None,
        item_id: str,
        kind: str,
        stops: int | None,
        batch: str = "",
    ) -> str:
        """Start a grasp; return the name of its recording.

        `batch`: batch of the item; empty for that of the page.
        """
        ...

    async def release(self, driver: str) -> None:
        """Release the object, or open the hand."""
        ...

    async def take_over(self, driver: str) -> None:
        """Make this client the driver."""
        ...

    async def leave(self, driver: str) -> None:
        """Give up control so that another client can drive."""
        ...

    def renew(self, driver: str) -> None:
        """Note that a client is still there; without it, the driver loses control after 5 s."""
        ...

    async def stop(self, by: str) -> bool:
        """Stop the hand; return whether the devices confirmed the stop."""
        ...


class Line(Protocol):
    """A running protocol server."""

    async def refresh(self) -> None:
        """Update the published values."""
        ...

    async def close(self) -> None:
        """Close every connection."""
        ...


class CommandRefusedError(Exception):
    """A command can't be executed now; the message is a one-line reason."""


def line_state(document: Mapping[str, Any]) -> LineState:
    """Return the line state for a state document.

    >>> line_state({"activity": "watching", "fresh": True, "hand_open": True, "trouble": ""}).name
    'IDLE'
    >>> line_state({"activity": "grasping", "phase": "hold", "answered": True}).name
    'HOLDING'
    """
    activity = document["activity"]
    if activity == "gone":
        return LineState.ABORTED
    if activity == "grasping":
        held = document["phase"] == "hold" and document["answered"]
        return LineState.HOLDING if held else LineState.EXECUTE
    if activity == "watching":
        if document["trouble"]:
            return LineState.ABORTED
        return LineState.IDLE if document["fresh"] and document["hand_open"] else LineState.STOPPED
    return LineState.STOPPED
