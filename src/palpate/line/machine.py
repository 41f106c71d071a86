"""A station for a line's controller: one state, one result, three commands."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from typing import Any, Protocol


class LineState(IntEnum):
    """States in the manner of PackML (ISA-TR88.00.02), as far as a station has them."""

    #: No rig, no fresh frames, or a hand that is not open: release first.
    STOPPED = 0
    #: A grasp can begin.
    IDLE = 1
    #: A grasp is under way.
    EXECUTE = 2
    #: The object is held and its answer is known: release it.
    HOLDING = 3
    #: The devices are gone or at fault.
    ABORTED = 4


class Machine(Protocol):
    """What a protocol needs of the server, on the event loop of the protocols.

    Commands raise `CommandRefusedError` where they can't be carried out now, `InputError` for a bad
    value.
    """

    def state(self) -> Mapping[str, Any]:
        """Return the state document (docs/schemas/state.json)."""
        ...

    def result(self) -> tuple[int, Mapping[str, Any] | None]:
        """Return how many grasps have ended in this run, and the document of the last."""
        ...

    async def grasp(
        self,
        driver: str,
        *,
        target_force_n: float | None,
        item_id: str,
        kind: str,
        stops: int | None,
    ) -> str:
        """Begin a grasp; return the name of its recording."""
        ...

    async def release(self, driver: str) -> None:
        """Release the object, or open the hand."""
        ...

    async def take_over(self, driver: str) -> None:
        """Drive from now on."""
        ...

    async def leave(self, driver: str) -> None:
        """Let another client drive."""
        ...

    async def stop(self) -> bool:
        """Stop; return whether the devices confirmed that the stop reached the hand."""
        ...


class Line(Protocol):
    """One protocol, serving."""

    async def refresh(self) -> None:
        """Show what has changed."""
        ...

    async def close(self) -> None:
        """Close every connection."""
        ...


class CommandRefusedError(Exception):
    """A command that can't be carried out now; its text is a one-line reason."""


def line_state(document: Mapping[str, Any]) -> LineState:
    """Return the state of a station from its state document.

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
