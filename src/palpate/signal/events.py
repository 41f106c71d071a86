"""Contact, removal and slip in a stream of relative changes, sample by sample."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from palpate.signal.relative import CONTACT_PERCENT

#: Fraction by which the change held follows a signal that rises, per sample.
_FORGET = 0.02


class EventKind(StrEnum):
    """The kind of an event of one finger."""

    CONTACT = "contact"
    REMOVAL = "removal"
    SLIP = "slip"


@dataclass(frozen=True, slots=True)
class ContactState:
    """State of one finger in `watch_contact`: touched or not, and the deepest change held."""

    touching: bool = False
    held_percent: float = 0.0
    slipping: bool = False


def watch_contact(
    state: ContactState, change_percent: float, *, threshold_percent: float = CONTACT_PERCENT
) -> tuple[ContactState, EventKind | None]:
    """Take one sample of a finger's relative change; return whether something happened.

    Contact is a change below the threshold; removal one above half of it (so that noise at the
    threshold gives no chatter). Slip is the loss of more than a quarter of the change held, while
    still touching. The change held follows the signal down at once and, by 2 % of the difference
    per sample, up: slow relaxation of a soft object is not slip.

    `state`: memory of the finger.
    `change_percent`: the finger's mean relative change; NaN (no pixel reads) changes nothing.
    `threshold_percent`: negative; the paper's is -10 % (section 4.1).
    Returns the new memory, and what happened at this sample.

    >>> state, event = watch_contact(ContactState(), -12.0)
    >>> state.touching, event.value
    (True, 'contact')
    """
    if np.isnan(change_percent):
        return state, None
    if not state.touching:
        if change_percent > threshold_percent:
            return state, None
        return ContactState(True, change_percent), EventKind.CONTACT
    if change_percent > 0.5 * threshold_percent:
        return ContactState(), EventKind.REMOVAL
    above = change_percent - state.held_percent
    held = state.held_percent + (above if above < 0 else _FORGET * above)
    slipping = change_percent > 0.75 * held and held < 2.0 * threshold_percent
    event = EventKind.SLIP if slipping and not state.slipping else None
    return ContactState(True, held, slipping), event
