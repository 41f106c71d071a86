"""Holds in a recording: the contact, and when only settling remains.

Nothing here depends on the sensor. A movement is a change of at least a tenth of the recording's
range within 0.3 s: a finger that closes or a weight that is laid down does that, a slow stretch
doesn't. All thresholds are shares of the range or multiples of the noise, so scale, sign and shift
of the reading don't matter.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray

#: A movement is a change of this fraction of the range ...
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
#: From contact to opening; a shorter touch is more often a step on the way than a hold. At
#: least half of it is left after loading.
SHORTEST_HOLD_S = 1.0
FEWEST_READINGS = 5
#: Loading takes no longer than this after contact; what still moves then is settling.
LOADING_S = 2.0
#: Ratio of the loading time to the time of the reading's knee: the reading is a power of the force,
#: and bends where the force is at two thirds. Median of 222 robot presses with a load cell; 1.5 on
#: 221 others.
LOADING_PER_KNEE = 1.5
#: A stretch whose last third moves by more than this fraction of its contact hasn't been held ...
STILL_SHARE = 0.1
#: ... unless that is less than this fraction of what its first third moved: it still settles.
SLOWING_SHARE = 0.5
#: Parts into which a hold is divided to see whether it settles.
JUDGED_PARTS = 12
#: In the last second before a contact the reading moves by at most this fraction of it.
STILL_BEFORE_SHARE = 0.25
#: The opening begins a little before it is fast; this much of the end isn't judged.
OPENING_S = 0.1
#: Stretches shorter than this are part of a movement, not a level.
BRIEFEST_S = 0.3
#: How much more the low levels scatter than the high ones where the recording begins loaded.
SCATTER_RATIO = 2.0

_TOO_BRIEF = f"none stays for {SHORTEST_HOLD_S:g} s"
_TOO_FEW = f"fewer than {FEWEST_READINGS} readings while it is held"


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

    Resistance goes as a power of force: from 1000 to 100 ohm equals that from 100 to 10.

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
    padded = np.pad(height, MEDIAN_CELLS // 2, mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_CELLS)
    smooth = np.asarray(np.median(windows, axis=-1))
    noise = 0.0
    if smooth.size > 2 * MEDIAN_CELLS:
        # Second differences are deaf to drift and edges.
        before, here, after = (smooth[at : smooth.size - 10 + at] for at in (0, 5, 10))
        noise = float(np.median(np.abs(after - 2 * here + before)) / 0.6745 / np.sqrt(6.0))
    step = max(MOVED_SHARE * float(np.ptp(smooth)), MOVED_SIGMAS * noise)
    moving = _find_moving(smooth, step=step, cells=max(1, round(MOVED_WITHIN_S / cell_s)))
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


def _find_moving(smooth: FloatArray, *, step: float, cells: int) -> NDArray[np.bool_]:
    """Return which cells lie within a window whose ends differ by a step.

    Shape (n_cells - 1,): cell i represents the step from i to i + 1.
    """
    moving = np.zeros(max(0, smooth.size - 1), dtype=np.bool_)
    if step <= 0:
        return moving
    for reach in range(1, min(cells, smooth.size - 1) + 1):
        fast = np.flatnonzero(np.abs(smooth[reach:] - smooth[:-reach]) >= step)
        # The shortest window that holds the step shows best where it is.
        total = np.concatenate(([0], np.cumsum(moving)))
        fresh = fast[total[fast + reach] == total[fast]]
        for place in range(reach):
            moving[fresh + place] = True
    return moving


def _stretches(
    at_s: FloatArray, smooth: FloatArray, moving: NDArray[np.bool_], *, step: float
) -> list[Stretch]:
    """Return the stretches between movements; a bounce is part of the movement before it."""
    edges = np.diff(np.concatenate(([0], moving.astype(np.int8), [0])))
    begins, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    apart = at_s[begins[1:]] - at_s[ends[:-1]] > BOUNCE_S
    if begins.size:
        begins = begins[np.concatenate(([True], apart))]
        ends = ends[np.concatenate((apart, [True]))]
    stops = [*begins.tolist(), at_s.size - 1]
    starts = [(0, 0), *zip(begins.tolist(), ends.tolist(), strict=True)]
    return [
        Stretch(
            onset_s=float(at_s[onset]),
            begin_s=float(at_s[begin]),
            end_s=float(at_s[stop]),
            before=float(smooth[onset]),
            level=float(np.median(smooth[(begin + stop) // 2 : stop + 1])),
        )
        for (onset, begin), stop in zip(starts, stops, strict=True)
    ]


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """One contact, and whether a hold follows it."""

    #: When the reading begins to move.
    onset_s: float
    #: When loading ends and when the next movement begins: the hold, where there is one.
    start_s: float
    end_s: float
    #: Why it is no hold; empty where it is one.
    refused: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cut:
    """The contacts of one column."""

    #: In order of time.
    contacts: list[Contact]
    #: Whether there is any fast movement.
    moves: bool
    #: Whether contact raises the reading.
    rises: bool
    #: Whether the recording begins in the middle of a hold, whose contact is not in it.
    began_loaded: bool

    @property
    def holds(self) -> list[Contact]:
        """The contacts that a hold follows; none where as many contacts as these don't settle."""
        held = [contact for contact in self.contacts if not contact.refused]
        brief = {_TOO_BRIEF, _TOO_FEW, ""}
        unsteady = sum(contact.refused not in brief for contact in self.contacts)
        return held if len(held) > unsteady else []

    def reason(self) -> str:
        """Return in words why there is no hold."""
        if not self.contacts and self.moves:
            return (
                "it moves fast, but comes back within a moment or never to load: no contact stays"
            )
        if not self.contacts:
            return (
                "no contact found: nothing in it moves by a tenth of its range, and out of its "
                f"noise, within {MOVED_WITHIN_S:g} s"
            )
        whys = Counter(contact.refused for contact in self.contacts if contact.refused)
        why = max(whys, key=lambda each: whys[each], default="")
        return f"{len(self.contacts)} contacts, but no hold: {why}"


def find_contacts(time_s: FloatArray, values: FloatArray, *, unit: str | None = None) -> Cut:
    """Find the contacts of a recording, and the hold after each.

    A recording begins at rest, unless levels show otherwise: a relative change is near 0 at rest,
    and resistance comes back to one level at rest while under load it differs from touch to touch.
    A hold begins where loading ends: half as long again after contact as the curve takes to bend
    most away from a straight line (its knee). After a fast contact that is at once.

    `time_s`, shape (n_times,): strictly increasing, seconds; sampling may be uneven.
    `values`, shape (n_times,): finite readings.
    `unit` ("ohm" or "percent"): helps to distinguish rest from load; any other unit, or None,
        doesn't.

    >>> time_s = np.arange(0, 9, 0.05)
    >>> found = find_contacts(time_s, np.where((time_s > 3) & (time_s < 6), 10.0, 50.0))
    >>> [(round(hold.start_s), round(hold.end_s)) for hold in found.holds]
    [(3, 6)]
    """
    shape = outline(time_s, values)
    if len(shape.stretches) < 2:
        return Cut(contacts=[], moves=False, rises=False, began_loaded=False)
    rises, began_loaded = _side_of_load(shape, unit)
    toward = 1.0 if rises else -1.0
    height = heights(values)
    loaded = [toward * (s.level - s.before) >= shape.step for s in shape.stretches]
    loaded[0] = False
    for place, stretch in enumerate(shape.stretches):
        rest = next((k for k in range(place, len(loaded)) if not loaded[k]), None)
        if loaded[place] and rest is not None:
            # What is no more than the next rest was no load, but a start that wore off.
            loaded[place] = toward * (stretch.level - shape.stretches[rest].level) >= shape.step
    contacts: list[Contact] = []
    for (last, stretch), held in zip(pairwise(shape.stretches), loaded[1:], strict=True):
        if held:
            start_s = _find_loading_end_s(stretch, toward, time_s=time_s, height=height)
            contacts.append(
                Contact(
                    onset_s=stretch.onset_s,
                    start_s=start_s,
                    end_s=stretch.end_s,
                    refused=_explain_refusal(stretch, last, shape, start_s, time_s=time_s),
                )
            )
    return Cut(contacts=contacts, moves=True, rises=rises, began_loaded=began_loaded)


def _side_of_load(shape: ContactOutline, unit: str | None) -> tuple[bool, bool]:
    """Return whether load is the upper side, and whether the recording begins loaded."""
    first, bottom, top = shape.stretches[0].level, shape.height.min(), shape.height.max()
    # What the recording departs to is load: it begins at rest.
    begins_low = bool(top - first > first - bottom)
    middle = 0.5 * (bottom + top)
    levels = np.array([s.level for s in shape.stretches if s.end_s - s.begin_s >= BRIEFEST_S])
    low, high = levels[levels < middle], levels[levels >= middle]
    if unit == "percent":
        # A relative change is 0 at rest.
        low_rests = bool(abs(bottom) < abs(top))
        return low_rests, begins_low != low_rests
    if unit == "ohm" and begins_low and min(low.size, high.size) >= 2:
        # Load lowers the resistance of every sheet that we know; that the recording begins with
        # load is believed where the low levels differ as touches do.
        began_loaded = bool(np.ptp(low) > SCATTER_RATIO * np.ptp(high))
        return not began_loaded, began_loaded
    return begins_low, False


def _find_loading_end_s(
    stretch: Stretch, toward: float, *, time_s: FloatArray, height: FloatArray
) -> float:
    """Return when loading ends: where the curve is farthest from its initial chord."""
    until_s = min(stretch.end_s, stretch.onset_s + LOADING_S)
    first = max(0, int(np.searchsorted(time_s, stretch.onset_s)) - 1)
    stop = int(np.searchsorted(time_s, until_s, side="right"))
    at_s, risen = time_s[first:stop], toward * height[first:stop]
    # An actuation spike goes the other way first; loading begins at its top.
    peak = int(np.argmin(risen[: max(1, int(np.searchsorted(at_s, stretch.begin_s)))]))
    at_s, risen = at_s[peak:], risen[peak:]
    if at_s.size < 3:
        return float(at_s[-1])
    chord = risen[0] + (risen[-1] - risen[0]) * (at_s - at_s[0]) / (at_s[-1] - at_s[0])
    knee_s = float(at_s[int(np.argmax(risen - chord))])
    return min(float(at_s[0]) + LOADING_PER_KNEE * (knee_s - float(at_s[0])), stretch.end_s)


def _explain_refusal(
    stretch: Stretch, last: Stretch, shape: ContactOutline, start_s: float, *, time_s: FloatArray
) -> str:
    """Return why a stretch after contact is no hold, or nothing."""
    held_s = stretch.end_s - start_s
    readings = int(np.searchsorted(time_s, stretch.end_s, side="right")) - int(
        np.searchsorted(time_s, start_s)
    )
    if stretch.end_s - stretch.onset_s < SHORTEST_HOLD_S or held_s < SHORTEST_HOLD_S / 2:
        return _TOO_BRIEF
    if readings < FEWEST_READINGS:
        return _TOO_FEW
    if not _is_still_before(stretch, last, shape):
        return "the reading moves before the contact too"
    return _explain_unsettled(stretch, shape, start_s)


def _is_still_before(stretch: Stretch, last: Stretch, shape: ContactOutline) -> bool:
    """Return whether the reading stands still for a moment before the contact.

    At the very beginning of a recording there need not be such a moment.
    """
    if last.onset_s < last.begin_s and last.end_s - last.begin_s < BRIEFEST_S:
        return False
    at_s = shape.time_s
    before = (at_s >= max(last.begin_s, last.end_s - 1.0)) & (at_s < stretch.onset_s)
    moved = float(np.ptp(shape.height[before])) if before.any() else 0.0
    return moved <= STILL_BEFORE_SHARE * abs(stretch.level - stretch.before) + 4.0 * shape.noise


def _explain_unsettled(stretch: Stretch, shape: ContactOutline, start_s: float) -> str:
    """Return why what is held doesn't settle, or nothing."""
    inside = (shape.time_s >= start_s) & (shape.time_s <= stretch.end_s - OPENING_S)
    parts = np.array_split(shape.height[inside], JUDGED_PARTS)
    path = np.diff([np.median(part) for part in parts if part.size])
    still = STILL_SHARE * abs(stretch.level - stretch.before) + 4.0 * shape.noise
    third = path.size // 3
    early, late = abs(float(path[:third].sum())), abs(float(path[-third:].sum()))
    if late > max(still, SLOWING_SHARE * early):
        return "the reading keeps moving instead of settling"
    if min(path[path > 0].sum(), -path[path < 0].sum()) > 2.0 * still:
        return "the reading wanders up and down instead of settling"
    return ""
