"""Contacts in a recording: fast movements, and the stretches of rest and load between them.

Nothing here knows a sensor. A movement is a change of at least a tenth of the recording's whole
range within 0.3 s: a finger that closes or a weight that is laid down does that, a slow stretch
doesn't. All thresholds are shares of the range or multiples of the noise, so scale, sign and shift
of the reading don't matter.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray

#: A movement is a change of this share of the range ...
MOVED_SHARE = 0.1
#: ... within this time, which is what the paper's fast processes take (0.09 s) three times over.
MOVED_WITHIN_S = 0.3
#: ... and of this many standard deviations of the noise: chance gives that in no recording.
MOVED_SIGMAS = 8.0
#: Movements nearer to each other than this belong together: a finger that bounces.
BOUNCE_S = 0.4
#: Cells are this long where the readings come faster: contacts are found in medians of cells.
CELL_S = 0.02
#: Cells in the running median: drops single outliers, keeps an edge where it is.
MEDIAN_CELLS = 5
#: Positive readings that span more than this ratio are compared by ratio (in their logarithm).
RATIO = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A stretch between two movements."""

    #: Where the movement before it begins, where it ends, and where the next one begins. For the
    #: first stretch `onset_s` is `begin_s`: how the recording came there is not known.
    onset_s: float
    begin_s: float
    end_s: float
    #: Height (see `heights`) before that movement, and of the stretch's later half.
    before: float
    level: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOutline:
    """A recording reduced to what decides where contacts are."""

    #: Shape (n_cells,). Middle of each cell, and the smoothed height there.
    time_s: FloatArray
    height: FloatArray
    #: Standard deviation of the heights' noise, and the change that counts as movement.
    noise: float
    step: float
    #: In order of time.
    stretches: list[Stretch]


def heights(values: FloatArray) -> FloatArray:
    """Return the logarithm of positive readings that span a large ratio, others as they are.

    Resistance goes as a power of force: from 1000 to 100 ohm is as much as from 100 to 10.

    >>> heights(np.array([1.0, 100.0])).round(2).tolist(), heights(np.array([9.0, 10.0])).tolist()
    ([0.0, 4.61], [9.0, 10.0])
    """
    positive = values.size > 0 and values.min() > 0 and values.max() > RATIO * values.min()
    return np.log(values) if positive else values


def outline(time_s: FloatArray, values: FloatArray) -> ContactOutline:
    """Find the movements of a recording and what lies between them.

    `time_s`, shape (n_times,): strictly increasing, seconds; sampling may be uneven.
    `values`, shape (n_times,): finite readings, in any unit.

    >>> time_s = np.arange(0, 9, 0.05)
    >>> found = outline(time_s, np.where((time_s > 3) & (time_s < 6), 10.0, 50.0))
    >>> [round(stretch.begin_s) for stretch in found.stretches]
    [0, 3, 6]
    """
    at_s, height, cell_s = _cells(time_s, heights(values))
    smooth = _running_median(height)
    noise = _noise(smooth)
    step = max(MOVED_SHARE * float(np.ptp(smooth)), MOVED_SIGMAS * noise)
    moving = _moving(smooth, step=step, cells=max(1, round(MOVED_WITHIN_S / cell_s)))
    stretches = _stretches(at_s, smooth, moving, step=step)
    return ContactOutline(time_s=at_s, height=smooth, noise=noise, step=step, stretches=stretches)


def _cells(time_s: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the middle of equal cells, the median reading in each, and their length.

    A cell without a reading keeps the one before: across a gap the step is placed at its end.
    """
    usual_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else CELL_S
    cell_s = max(CELL_S, usual_s)
    # Half a cell of slack: readings of an even clock lie in the middle of their cells.
    number = np.floor((time_s - time_s[0]) / cell_s + 0.5).astype(np.intp)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(starts, append=number.size)
    order = np.lexsort((height, number))
    ranked = height[order]
    median = 0.5 * (ranked[starts + (counts - 1) // 2] + ranked[starts + counts // 2])
    filled = np.searchsorted(number[starts], np.arange(number[-1] + 1), side="right") - 1
    return time_s[0] + cell_s * np.arange(filled.size), median[filled], cell_s


def _running_median(height: FloatArray) -> FloatArray:
    side = MEDIAN_CELLS // 2
    padded = np.pad(height, side, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_CELLS)
    middle: FloatArray = np.median(windows, axis=-1)
    return middle


def _noise(smooth: FloatArray) -> float:
    """Return the noise's standard deviation from second differences, deaf to drift and edges."""
    apart = MEDIAN_CELLS
    if smooth.size < 2 * apart + 1:
        return 0.0
    bend = smooth[2 * apart :] - 2 * smooth[apart:-apart] + smooth[: -2 * apart]
    return float(np.median(np.abs(bend)) / 0.6745 / np.sqrt(6.0))


def _moving(smooth: FloatArray, *, step: float, cells: int) -> NDArray[np.bool_]:
    """Return which cells lie within a window whose ends differ by a step.

    Shape (n_cells - 1,): cell i represents the step from i to i + 1.
    """
    moving = np.zeros(max(0, smooth.size - 1), dtype=np.bool_)
    if step <= 0:
        return moving
    for reach in range(1, min(cells, smooth.size - 1) + 1):
        fast = np.flatnonzero(np.abs(smooth[reach:] - smooth[:-reach]) >= step)
        # The shortest window that holds the step shows best where it is.
        fresh = fast[~_any_within(moving, fast, reach)] if reach > 1 else fast
        for place in range(reach):
            moving[fresh + place] = True
    return moving


def _any_within(
    flags: NDArray[np.bool_], starts: NDArray[np.intp], reach: int
) -> NDArray[np.bool_]:
    total = np.concatenate(([0], np.cumsum(flags)))
    return np.asarray(total[starts + reach] > total[starts], dtype=np.bool_)


def _stretches(
    at_s: FloatArray, smooth: FloatArray, moving: NDArray[np.bool_], *, step: float
) -> list[Stretch]:
    """Return the stretches between movements; a bounce is part of the movement before it."""
    edges = np.diff(np.concatenate(([0], moving.astype(np.int8), [0])))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if begins.size == 0:
        return [_stretch(at_s, smooth, 0, 0, at_s.size - 1)]
    apart = at_s[begins[1:]] - at_s[ends[:-1]] > BOUNCE_S
    begins, ends = begins[np.concatenate(([True], apart))], ends[np.concatenate((apart, [True]))]
    stops = [*begins.tolist(), at_s.size - 1]
    starts = [(0, 0), *zip(begins.tolist(), ends.tolist(), strict=True)]
    return [
        _stretch(at_s, smooth, onset, begin, stop)
        for (onset, begin), stop in zip(starts, stops, strict=True)
    ]


def _stretch(at_s: FloatArray, smooth: FloatArray, onset: int, begin: int, stop: int) -> Stretch:
    return Stretch(
        onset_s=float(at_s[onset]),
        begin_s=float(at_s[begin]),
        end_s=float(at_s[stop]),
        before=float(smooth[onset]),
        level=float(np.median(smooth[(begin + stop) // 2 : stop + 1])),
    )
