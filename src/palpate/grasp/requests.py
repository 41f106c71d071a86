"""Requests to a running grasp: made from any thread, handled before the next frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Event


@dataclass(frozen=True, slots=True)
class Requests:
    """Requests to a running grasp, each executed once; set an event to request.

    `stop`: end the grasp at once; `palpate.grasp.safety` defines the movement of the hand.
    `release`: release the object in any phase.

    >>> requests = Requests()
    >>> requests.stop.set()
    >>> requests.stop.is_set(), requests.release.is_set()
    (True, False)
    """

    stop: Event = field(default_factory=Event)
    release: Event = field(default_factory=Event)
