"""Requests to a running grasp: made from any thread, handled before the next frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Event


@dataclass(frozen=True, slots=True)
class Requests:
    """Requests to a running grasp, each carried out once; set an event to make one.

    `stop`: end it at once; what that means for the hand is in `palpate.grasp.safety`.
    `release`: give the object back, whatever the grasp is doing.

    >>> requests = Requests()
    >>> requests.stop.set()
    >>> requests.stop.is_set(), requests.release.is_set()
    (True, False)
    """

    stop: Event = field(default_factory=Event)
    release: Event = field(default_factory=Event)
