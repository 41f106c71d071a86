"""Contact, slip and removal in a whole recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.signal.events import ContactState, EventKind, watch_contact
from palpate.signal.relative import CONTACT_PERCENT


@dataclass(frozen=True, slots=True, kw_only=True)
class SignalEvent:
    """What happened on a finger, at the first sample that shows it."""

    kind: EventKind
    time_s: float
    finger: int


def running_median(values: ArrayLike, *, length: int) -> FloatArray:
    """Return the median of each sample and the `length` - 1 before it; NaN is left out.

    It drops single outliers and delays a step by half its length.

    Examples
    --------
    >>> running_median([0.0, 9.0, 0.0, 1.0], length=3).tolist()
    [0.0, 4.5, 0.0, 1.0]
    """
    signal = np.asarray(values, dtype=np.float64)
    padding = np.full((length - 1, *signal.shape[1:]), np.nan)
    padded = np.concatenate([padding, signal])
    windows = np.lib.stride_tricks.sliding_window_view(padded, length, axis=0)
    ordered = np.sort(windows, axis=-1)
    count = np.sum(~np.isnan(windows), axis=-1, keepdims=True)
    middle = [np.maximum(count - 1, 0) // 2, np.minimum(count // 2, length - 1)]
    pair = [np.take_along_axis(ordered, index, axis=-1)[..., 0] for index in middle]
    median: FloatArray = 0.5 * (pair[0] + pair[1])
    return median


def contact_events(
    time_s: ArrayLike,
    finger_percent: ArrayLike,
    *,
    threshold_percent: float = CONTACT_PERCENT,
    smooth: int = 3,
) -> list[SignalEvent]:
    """Find contact, slip and removal of each finger.

    Parameters
    ----------
    time_s : array_like, shape (n_times,)
        Times.
    finger_percent : array_like, shape (n_times, fingers)
        Mean relative change of each finger (`palpate.signal.relative.finger_means`).
    threshold_percent : float
        See `watch_contact`.
    smooth : int
        Samples of the running median taken before.

    Returns
    -------
    list of SignalEvent
        In order of time.

    Examples
    --------
    >>> touch = contact_events([0.0, 0.1, 0.2], [[0.0], [-20.0], [-30.0]], smooth=1)
    >>> [(event.kind.value, event.time_s, event.finger) for event in touch]
    [('contact', 0.1, 0)]
    """
    time = np.asarray(time_s, float)
    signal = running_median(finger_percent, length=smooth)
    events: list[SignalEvent] = []
    states = [ContactState()] * signal.shape[1]
    for index, now_s in enumerate(time):
        for finger, change in enumerate(signal[index]):
            states[finger], kind = watch_contact(
                states[finger], float(change), threshold_percent=threshold_percent
            )
            if kind is not None:
                events.append(SignalEvent(kind=kind, time_s=float(now_s), finger=finger))
    return events
