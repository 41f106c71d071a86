"""Where settling begins: after a baseline, at the peak, or past contact ringing."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.signal.transient import find_peak

#: A baseline stays within this share of the whole change for at least this long (s) and this many
#: samples; the change then reaches the larger share within three quarters of that time or one
#: sample, while a curve that relaxes from the start slows down and takes three times as long.
_FLAT, _FLAT_S, _FLAT_SAMPLES = 0.1, 0.1, 2
_GONE, _SUDDEN = 0.4, 0.75
#: A change of a positive reading by a fifth within this time (s) is a contact; where zero is
#: not known, so is a change that makes up nearly all there is. What rings is left out; time still
#: counts from the contact.
_CONTACT_LOG, _CONTACT_SHARE, _CONTACT_S, _RUNG_OUT_S = 0.2, 0.9, 0.3, 0.35
#: Samples are left out only if this many, over this long (s), are left.
_FEWEST_LEFT, _SHORTEST_LEFT_S = 4, 0.25
#: Fewer runs of equal samples show no period of renewal.
_FEWEST_RUNS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Window:
    """Holds that share an origin and the samples to use."""

    #: Which holds.
    rows: NDArray[np.intp]
    #: Shape (n_used,). Times of the samples to use, seconds after the origin.
    since_s: FloatArray
    #: Index of the origin, and of the first sample to use.
    origin: int
    first: int


def windows(time_s: FloatArray, values: FloatArray, *, positive: bool) -> Iterator[Window]:
    """Group holds by their time origin and the first sample that shows their settling.

    `positive`: whether they are logarithms of positive values: then the size of a fall shows a
    contact.

    A second of rest, then contact, which is left out with what may ring:

    >>> time_s = np.arange(0.0, 3.0, 0.05)
    >>> held = np.where(time_s < 1.0, 0.0, -2.0 - 0.1 * np.log(np.maximum(time_s - 0.95, 0.05)))
    >>> [window] = windows(time_s, held[None], positive=True)
    >>> float(time_s[window.origin].round(2)), float(time_s[window.first].round(2))
    (0.95, 1.3)
    """
    rested = _baseline_end(time_s, values)
    origin = np.maximum(find_peak(values), rested)
    rows, begin_s = np.arange(len(values)), time_s[origin]
    start = values[rows, origin]
    soon = time_s.searchsorted(begin_s + _CONTACT_S, side="right") - 1
    jump = np.abs(start - values[rows, soon])
    least = _CONTACT_LOG
    if not positive:
        least = _CONTACT_SHARE * np.abs(values - start[:, None]).max(axis=1)
    contact = (jump > least) | (rested > 0)
    later = time_s.searchsorted(begin_s + _RUNG_OUT_S - 1e-9)
    # Where too few samples come after the ringing, none is left out.
    enough = (later + _FEWEST_LEFT <= time_s.size) & (
        time_s[-1] - time_s[np.minimum(later, time_s.size - 1)] >= _SHORTEST_LEFT_S
    )
    keys = origin * time_s.size + np.where(contact & enough, later, origin)
    for key in dict.fromkeys(keys.tolist()):
        at, first = divmod(key, time_s.size)
        yield Window(
            rows=(keys == key).nonzero()[0],
            since_s=time_s[first:] - time_s[at],
            origin=at,
            first=first,
        )


def _baseline_end(time_s: FloatArray, values: FloatArray) -> NDArray[np.intp]:
    """Return the last sample of a flat stretch in front, 0 if there is none."""
    could_end = max(int((time_s - time_s[0]).searchsorted(_FLAT_S)), _FLAT_SAMPLES - 1)
    away = np.abs(values - values[:, :1])
    whole = away.max(axis=1, keepdims=True)
    if could_end >= time_s.size or (away[:, could_end] > _FLAT * whole[:, 0]).all():
        return np.zeros(len(values), dtype=np.intp)
    left = away > _FLAT * whole
    flat = left.argmax(axis=1) - 1
    gone = (away > _GONE * whole).argmax(axis=1)
    lasted_s = time_s[flat] - time_s[0]
    sudden = (time_s[gone] - time_s[flat] <= _SUDDEN * lasted_s) | (gone == flat + 1)
    # It must have stayed away: a hold that returns to where it began has no baseline there.
    end: NDArray[np.intp] = np.where((flat >= could_end) & sudden & left.any(axis=1), flat, 0)
    return end


def find_renewals(values: FloatArray) -> NDArray[np.intp]:
    """Return the samples of one hold at which its reading was renewed.

    A reading that is logged more often than the instrument renews it repeats itself in runs of
    about one length; only the first of each run is of its time. All samples, where runs differ as
    those of a rounded reading do.

    `values`, shape (n_times,).

    >>> find_renewals(np.array([5.0, 5.0, 4.5, 4.5, 4.2, 4.2])).tolist()
    [0, 2, 4]
    >>> find_renewals(np.array([5.0, 5.0, 4.5, 4.4, 4.2, 4.2])).tolist()
    [0, 1, 2, 3, 4, 5]
    """
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    runs = np.diff(np.append(starts, values.size))
    if runs.size < _FEWEST_RUNS or runs[:-1].min() < 2 or runs.max() > 2 * runs[:-1].min() + 1:
        return np.arange(values.size)
    return starts
