"""Requests to a running grasp: made from any thread, handled before the next frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from threading import Event


@dataclass(frozen=True, slots=True)
class Requests:
    """Wishes for one grasp, fulfilled once. Set an event to wish for it.

    Attributes
    ----------
    stop : Event
        End it at once; what that means for the hand is in `palpate.grasp.safety`.
    release : Event
        Give the object back, whatever the grasp is doing.

    Examples
    --------
    >>> requests = Requests()
    >>> requests.stop.set()
    >>> requests.stop.is_set(), requests.release.is_set()
    (True, False)
    """

    stop: Event = field(default_factory=Event)
    release: Event = field(default_factory=Event)
