"""Detection of contact, removal and slip in a stream of relative changes."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from palpate.signal.relative import CONTACT_PERCENT

#: Fraction per sample by which the held change follows a rising signal.
_FOLLOW_FRACTION = 0.02


class EventKind(StrEnum):
    """Kind of event on one finger."""

    CONTACT = "contact"
    REMOVAL = "removal"
    SLIP = "slip"


@dataclass(frozen=True, slots=True)
class ContactState:
    """State of one finger in `watch_contact`: contact, held change and slip."""

    is_touching: bool = False
    held_percent: float = 0.0
    is_slipping: bool = False


def watch_contact(
    state: ContactState, change_percent: float, *, threshold_percent: float = CONTACT_PERCENT
) -> tuple[ContactState, EventKind | None]:
    """Update a finger's state with one sample; return the new state and event.

    Contact is a change at or below the threshold. Removal is a change above half of the threshold;
    the hysteresis suppresses chatter from noise. Slip is the loss of more than a quarter of the
    held change, if that is more than twice the threshold. The held change follows a falling signal
    at once, and a rising signal by 2 % of the difference per sample. Slow relaxation of a soft
    object is therefore not slip.

    `state`: previous state of the finger.
    `change_percent`: the finger's mean relative change; NaN (no valid pixel) has no effect.
    `threshold_percent`: negative; the paper's is -10 % (section 4.1).

    >>> state, event = watch_contact(ContactState(), -12.0)
    >>> state.is_touching, event.value
    (True, 'contact')
    """
    if np.isnan(change_percent):
        return state, None
    if not state.is_touching:
        if change_percent > threshold_percent:
            return state, None
        return ContactState(True, change_percent), EventKind.CONTACT
    if change_percent > 0.5 * threshold_percent:
        return ContactState(), EventKind.REMOVAL
    above = change_percent - state.held_percent
    held = state.held_percent + (above if above < 0 else _FOLLOW_FRACTION * above)
    is_slipping = change_percent > 0.75 * held and held < 2.0 * threshold_percent
    event = EventKind.SLIP if is_slipping and not state.is_slipping else None
    return ContactState(True, held, is_slipping), event
