"""Start of settling: after a baseline, at the peak, or after contact ringing."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray

#: A baseline is within this fraction of the total change for at least this time (s) and number of
#: samples. The change then reaches the larger fraction within three quarters of the baseline's
#: duration or within one sample. A curve that relaxes from the start needs three times as long.
_FLAT, _FLAT_S, _FLAT_SAMPLES = 0.1, 0.1, 2
_DEPARTED, _SUDDEN = 0.4, 0.75
#: A contact is a change of a positive reading by a fifth, or of a signed reading by nearly its
#: total change, within this time (s). Samples with ringing are skipped, but time is still measured
#: from the contact.
_CONTACT_LOG, _CONTACT_FRACTION, _CONTACT_S, _RINGING_S = 0.2, 0.9, 0.3, 0.35
#: Minimum number and duration (s) of the samples after the ringing.
_MIN_SAMPLES, _MIN_DURATION_S = 4, 0.25
#: Minimum number of runs of equal samples that shows an update interval.
_MIN_RUNS = 3


#: Rows of a batch. All of them are a slice, which is faster to index.
Rows: TypeAlias = "NDArray[np.intp] | slice"


class Window(NamedTuple):
    """Holds with the same origin and the same samples to use."""

    rows: Rows
    #: Shape (n_used,). Times of the samples to use, seconds after the origin.
    since_s: FloatArray
    #: Index of the origin, and of the first sample to use.
    origin: int
    first: int


def group_rows(keys: NDArray[np.intp]) -> Iterator[tuple[int, Rows]]:
    """Yield each distinct key with its rows.

    >>> [(key, rows) for key, rows in group_rows(np.array([4, 4]))]
    [(4, slice(None, None, None))]
    """
    distinct = dict.fromkeys(keys.tolist())
    for key in distinct:
        yield key, (keys == key).nonzero()[0] if len(distinct) > 1 else slice(None)


def find_windows(time_s: FloatArray, values: FloatArray, *, positive: bool) -> Iterator[Window]:
    """Group holds by time origin and first sample of settling.

    `values`: changes relative to the last sample, shape (n_holds, n_times).
    `positive`: whether the values are logarithms of positive readings. The size of a change then
        identifies a contact.

    A second of rest, then contact; the contact and possible ringing are skipped:

    >>> time_s = np.arange(0.0, 3.0, 0.05)
    >>> hold = np.where(time_s < 1.0, 0.0, -2.0 - 0.1 * np.log(np.maximum(time_s - 0.95, 0.05)))
    >>> [window] = find_windows(time_s, hold[None] - hold[-1], positive=True)
    >>> float(time_s[window.origin].round(2)), float(time_s[window.first].round(2))
    (0.95, 1.3)
    """
    rows = np.arange(len(values))
    # The extreme with the largest change after it; of equal extremes the earlier.
    peak = np.abs(values).argmax(axis=1)
    baseline_end = _find_baseline_end(time_s, values)
    origins = np.maximum(peak, baseline_end)
    start = values[rows, origins]
    soon = time_s.searchsorted(time_s.take(origins) + _CONTACT_S, side="right") - 1
    min_jump = _CONTACT_LOG
    if not positive:
        min_jump = _CONTACT_FRACTION * np.maximum.reduce(np.abs(values - start[:, None]), axis=1)
    has_contact = (np.abs(start - values[rows, soon]) > min_jump) | (baseline_end > 0)
    for key, chosen in group_rows(2 * origins + has_contact):
        origin = first = key // 2
        zero_s = time_s[origin]
        if key % 2:
            later = int(time_s.searchsorted(zero_s + _RINGING_S - 1e-9))
            rest_s = time_s[later:]
            # The ringing is only skipped if there are enough samples after it.
            if rest_s.size >= _MIN_SAMPLES and rest_s[-1] - rest_s[0] >= _MIN_DURATION_S:
                first = later
        yield Window(rows=chosen, since_s=time_s[first:] - zero_s, origin=origin, first=first)


def _find_baseline_end(time_s: FloatArray, values: FloatArray) -> NDArray[np.intp]:
    """Return the last sample of a flat initial baseline; 0 if there is none."""
    min_end = max(int((time_s - time_s[0]).searchsorted(_FLAT_S)), _FLAT_SAMPLES - 1)
    end = np.zeros(len(values), dtype=np.intp)
    if min_end >= time_s.size:
        return end
    change = np.abs(values - values[:, :1])
    total = np.maximum.reduce(change, axis=1)
    [rows] = (change[:, min_end] <= _FLAT * total).nonzero()
    if rows.size:
        change, total = change[rows], total[rows, None]
        # -1 for a constant hold, which never leaves the baseline.
        flat = (change > _FLAT * total).argmax(axis=1) - 1
        departed = (change > _DEPARTED * total).argmax(axis=1)
        duration_s = time_s[flat] - time_s[0]
        is_sudden = time_s[departed] - time_s[flat] <= _SUDDEN * duration_s
        is_sudden |= departed == flat + 1
        end[rows] = np.where((flat >= min_end) & is_sudden, flat, 0)
    return end


def find_updates(values: FloatArray) -> NDArray[np.intp]:
    """Return the samples of one hold at which the instrument updated its reading.

    A reading logged faster than the instrument's update rate repeats in runs of nearly equal
    length. Only the first sample of a run has the correct time. If the runs differ in length, as
    for a rounded reading, all samples are returned.

    `values`, shape (n_times,).

    >>> find_updates(np.array([5.0, 5.0, 4.5, 4.5, 4.2, 4.2])).tolist()
    [0, 2, 4]
    >>> find_updates(np.array([5.0, 5.0, 4.5, 4.4, 4.2, 4.2])).tolist()
    [0, 1, 2, 3, 4, 5]
    """
    starts = np.concatenate([[0], np.flatnonzero(values[1:] != values[:-1]) + 1])
    runs = np.diff(np.append(starts, values.size))
    if runs.size < _MIN_RUNS or runs[:-1].min() < 2 or runs.max() > 2 * runs[:-1].min() + 1:
        return np.arange(values.size)
    return starts
