"""Contacts and holds in a recording of any sensor.

A movement is a change of at least a tenth of the recording's range within 0.3 s, caused for example
by a closing finger or a weight. A slow drift is not a movement. All thresholds are fractions of the
range or multiples of the noise, so the result does not depend on the reading's scale, sign or
offset.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from palpate.arrays import FloatArray
from palpate.holds.slow_loading import (
    SlowContact,
    estimate_load,
    find_full_scale,
    find_slow_contacts,
)

#: Smallest change of a movement, as a fraction of the range.
MOVED_FRACTION = 0.1
#: Time within which this change occurs, seconds; three times the paper's fast processes (0.09 s).
MOVED_WITHIN_S = 0.3
#: Smallest change of a movement in standard deviations of the noise, to exclude chance.
MOVED_SIGMAS = 8.0
#: Movements separated by less than this time are merged, such as those of a bouncing finger.
BOUNCE_S = 0.4
#: Shortest cell, seconds. Contacts are found in the median readings of the cells.
CELL_S = 0.02
#: Longest part of a gap without readings that is filled, seconds.
LONGEST_GAP_S = 600.0
#: Length of the running median above which it moves a knee by more than the loading's uncertainty.
COARSE_S = 1.0
#: Cells in the running median, which removes single outliers and preserves edges.
MEDIAN_CELLS = 5
#: Positive readings that span more than this ratio are compared on a logarithmic scale.
LOG_RATIO = 2.0
#: Shortest hold, from contact to opening, seconds. A shorter touch is usually an intermediate step
#: of a movement. At least half of this time must remain after loading.
SHORTEST_HOLD_S = 1.0
MIN_READINGS = 5
#: Longest loading time after contact; later change counts as settling.
LOADING_S = 2.0
#: Ratio of the loading time to the time of the reading's knee. The reading is a power of the force,
#: with its knee at two thirds of the force. Median of 222 robot presses with a load cell; also 1.5
#: on 221 others.
LOADING_PER_KNEE = 1.5
#: Largest change in the last third of a hold, as a fraction of the contact step. A larger change is
#: accepted while it is below the second fraction, which is relative to the change in the first
#: third: the reading is still settling.
STILL_FRACTION = 0.1
SLOWING_FRACTION = 0.5
#: Number of parts into which a hold is divided to check that the reading settles.
SETTLING_PARTS = 12
#: Largest change in the last second before a contact, as a fraction of the contact step.
STILL_BEFORE_FRACTION = 0.25
#: The opening begins slowly; the check ignores this much of the end of a hold.
OPENING_S = 0.1
#: Stretches shorter than this are part of a movement, not a level.
MIN_LEVEL_S = 0.3
#: Minimum ratio of the scatter of low to high levels in a recording that begins under load.
SCATTER_RATIO = 2.0

#: Units of the load itself.
_LOADS = ("newton", "pascal")

_TOO_SHORT = f"none lasts {SHORTEST_HOLD_S:g} s"
_TOO_FEW = f"fewer than {MIN_READINGS} readings during the hold"


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """A stretch between two movements."""

    #: Start and end of the preceding movement, and start of the next movement. In the first
    #: stretch `onset_s` equals `begin_s`, because the preceding movement was not recorded.
    onset_s: float
    begin_s: float
    end_s: float
    #: Height (see `log_if_wide`) before the preceding movement, and of the stretch's second half.
    before: float
    level: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ContactOutline:
    """A smoothed recording, divided into stretches between movements."""

    #: Shape (n_cells,). Middle of each cell, and the smoothed height in the cell.
    time_s: FloatArray
    height: FloatArray
    #: Standard deviation of the heights' noise, and the change that counts as movement.
    noise: float
    step: float
    #: In order of time.
    stretches: list[Stretch]


def log_if_wide(values: FloatArray) -> FloatArray:
    """Return the logarithm of positive readings with a large ratio; else the readings.

    Resistance is a power of force, so 1000 to 100 ohm is the same step as 100 to 10 ohm.

    >>> log_if_wide(np.array([1.0, 100.0])).round(2).tolist()
    [0.0, 4.61]
    >>> log_if_wide(np.array([9.0, 10.0])).tolist()
    [9.0, 10.0]
    """
    positive = values.size > 0 and values.min() > 0 and values.max() > LOG_RATIO * values.min()
    return np.log(values) if positive else values


def scale_height(values: FloatArray, *, unit: str | None) -> FloatArray:
    """Return the readings on the scale on which contacts are compared.

    Force and pressure are near 0 at rest, where a logarithm would magnify their noise.
    """
    return values if unit in _LOADS else log_if_wide(values)


def find_stretches(
    time_s: FloatArray, values: FloatArray, *, unit: str | None = None
) -> ContactOutline:
    """Find the movements of a recording and the stretches between them.

    `time_s`, shape (n_times,): strictly increasing, seconds; sampling may be uneven.
    `values`, shape (n_times,): finite readings, in any unit.
    `unit`: force and pressure are compared on a linear scale.

    >>> time_s = np.arange(0, 9, 0.05)
    >>> found = find_stretches(time_s, np.where((time_s > 3) & (time_s < 6), 10.0, 50.0))
    >>> [round(stretch.begin_s) for stretch in found.stretches]
    [0, 3, 6]
    """
    at_s, height, cell_s = _median_cells(time_s, scale_height(values, unit=unit))
    smooth = median_filter(height, size=MEDIAN_CELLS, mode="nearest")
    noise = 0.0
    if smooth.size > 2 * MEDIAN_CELLS:
        # Second differences are insensitive to drift and edges.
        kept = smooth.size - 2 * MEDIAN_CELLS
        before, here, after = (smooth[at : at + kept] for at in (0, MEDIAN_CELLS, 2 * MEDIAN_CELLS))
        noise = float(np.median(np.abs(after - 2 * here + before)) / 0.6745 / np.sqrt(6.0))
    step = max(MOVED_FRACTION * float(np.ptp(smooth)), MOVED_SIGMAS * noise)
    moving = _find_moving(smooth, step=step, cells=max(1, round(MOVED_WITHIN_S / cell_s)))
    stretches = _split_stretches(at_s, smooth, moving, step=step)
    return ContactOutline(time_s=at_s, height=smooth, noise=noise, step=step, stretches=stretches)


def _median_cells(time_s: FloatArray, height: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return the middle and median reading of equal cells, and the cell length.

    An empty cell repeats the previous median, so a step across a gap is at the end of the gap. Of
    a gap only the last `LONGEST_GAP_S` have cells, because a clock may jump by years.
    """
    interval_s = float(np.median(np.diff(time_s))) if time_s.size > 1 else CELL_S
    cell_s = max(CELL_S, interval_s)
    # The offset of half a cell puts evenly sampled readings in the middle of their cells.
    number = np.floor((time_s - time_s[0]) / cell_s + 0.5).astype(np.intp)
    starts = np.flatnonzero(np.diff(number, prepend=-1))
    counts = np.diff(starts, append=number.size)
    order = np.lexsort((height, number))
    ranked = height[order]
    median = 0.5 * (ranked[starts + (counts - 1) // 2] + ranked[starts + counts // 2])
    cell = number[starts]
    counts = np.minimum(np.diff(cell, append=cell[-1] + 1), max(1, round(LONGEST_GAP_S / cell_s)))
    filled = np.repeat(np.arange(cell.size), counts)
    # Cells before the next reading, by their distance from it.
    before = np.cumsum(counts)[filled] - np.arange(filled.size)
    following = np.append(cell[1:], cell[-1] + 1)[filled]
    return time_s[0] + cell_s * (following - before), median[filled], cell_s


def _find_moving(smooth: FloatArray, *, step: float, cells: int) -> NDArray[np.bool_]:
    """Return whether each change between adjacent cells belongs to a movement.

    Movements: the shortest windows whose ends differ by at least `step`.
    `cells`: longest window, in cells. Returns shape (n_cells - 1,); element i is the change from
    cell i to i + 1.
    """
    moving = np.zeros(max(0, smooth.size - 1), dtype=np.bool_)
    if step <= 0:
        return moving
    for width in range(1, min(cells, smooth.size - 1) + 1):
        fast = np.flatnonzero(np.abs(smooth[width:] - smooth[:-width]) >= step)
        # The shortest window that contains the step locates it best.
        total = np.concatenate(([0], np.cumsum(moving)))
        new = fast[total[fast + width] == total[fast]]
        for offset in range(width):
            moving[new + offset] = True
    return moving


def _split_stretches(
    at_s: FloatArray, smooth: FloatArray, moving: NDArray[np.bool_], *, step: float
) -> list[Stretch]:
    """Return the stretches between movements; a bounce is part of the preceding movement."""
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

    #: Time at which the reading begins to change.
    onset_s: float
    #: End of loading and start of the next movement: the limits of the hold.
    start_s: float
    end_s: float
    #: The reason why no hold follows; empty for a hold.
    refused: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class ColumnContacts:
    """The contacts of one column."""

    #: In order of time.
    contacts: list[Contact]
    #: Whether the recording contains a fast movement.
    moves: bool
    #: Whether contact raises the reading.
    rises: bool
    #: Whether the recording begins during a hold, after its contact.
    began_loaded: bool

    @property
    def holds(self) -> list[Contact]:
        """Contacts followed by a hold; empty unless they outnumber the unsettled contacts."""
        held = [contact for contact in self.contacts if not contact.refused]
        unsettled = [one for one in self.contacts if one.refused not in ("", _TOO_SHORT, _TOO_FEW)]
        return held if len(held) > len(unsettled) else []

    def reason(self) -> str:
        """Return the reason why no hold was found."""
        if not self.contacts and self.moves:
            return "fast movements, but no lasting contact"
        if not self.contacts:
            return (
                "no contact found: the reading never changes by a tenth of its range, and by more "
                f"than its noise, within {MOVED_WITHIN_S:g} s"
            )
        reasons = Counter(contact.refused for contact in self.contacts if contact.refused)
        reason = max(reasons, key=lambda each: reasons[each], default="")
        return f"contact, but no hold: {reason}"


def find_contacts(
    time_s: FloatArray, values: FloatArray, *, unit: str | None = None
) -> ColumnContacts:
    """Find the contacts of a recording, and the hold after each contact.

    A recording is assumed to begin at rest unless its levels contradict this. A relative change is
    near 0 at rest. Resistance returns to the same level at rest but differs between touches under
    load. A hold begins at the end of loading, at 1.5 times the time from contact to the knee of the
    curve (its largest distance from a straight line). After a fast contact it begins at once.

    `time_s`, shape (n_times,): strictly increasing, seconds; sampling may be uneven.
    `values`, shape (n_times,): finite readings.
    `unit` ("ohm" or "percent"): helps to distinguish rest from load; any other unit, or None, has
        no effect.

    >>> time_s = np.arange(0, 9, 0.05)
    >>> found = find_contacts(time_s, np.where((time_s > 3) & (time_s < 6), 10.0, 50.0))
    >>> [(round(hold.start_s), round(hold.end_s)) for hold in found.holds]
    [(3, 6)]
    """
    outline = find_stretches(time_s, values, unit=unit)
    slow, slow_rises = _find_slow(time_s, values, unit=unit)
    if len(outline.stretches) < 2 and not slow:
        return ColumnContacts(contacts=[], moves=False, rises=False, began_loaded=False)
    rises, began_loaded = _find_load_side(outline, unit)
    if slow:
        rises, began_loaded = slow_rises, False
    sign = 1.0 if rises else -1.0
    height = scale_height(values, unit=unit)
    loaded = [sign * (s.level - s.before) >= outline.step for s in outline.stretches]
    loaded[0] = False
    for place, stretch in enumerate(outline.stretches):
        rest = next((k for k in range(place, len(loaded)) if not loaded[k]), None)
        if loaded[place] and rest is not None:
            # A level no higher than the next rest is a decaying start-up offset, not a load.
            loaded[place] = sign * (stretch.level - outline.stretches[rest].level) >= outline.step
    # The end of the loading is 1.5 times its knee in a reading, and the knee in the load itself.
    per_knee = 1.0 if unit in _LOADS else LOADING_PER_KNEE
    contacts = [Contact(onset_s=one.onset_s, start_s=one.start_s, end_s=one.end_s) for one in slow]
    for (last, stretch), held in zip(pairwise(outline.stretches), loaded[1:], strict=True):
        overlaps = any(s.onset_s < stretch.end_s and stretch.onset_s < s.end_s for s in slow)
        if held and not overlaps:
            start_s = _find_loading_end_s(stretch, sign * height, time_s=time_s, per_knee=per_knee)
            contacts.append(
                Contact(
                    onset_s=stretch.onset_s,
                    start_s=start_s,
                    end_s=stretch.end_s,
                    refused=_explain_refusal(stretch, last, outline, start_s, time_s=time_s),
                )
            )
    contacts.sort(key=lambda contact: contact.onset_s)
    return ColumnContacts(contacts=contacts, moves=True, rises=rises, began_loaded=began_loaded)


def _find_slow(
    time_s: FloatArray, values: FloatArray, *, unit: str | None
) -> tuple[list[SlowContact], bool]:
    """Return the contacts with slow loading, and whether load raises the reading."""
    at_s, height, cell_s = _median_cells(time_s, values)
    smooth = median_filter(height, size=MEDIAN_CELLS, mode="nearest")
    first = float(np.median(smooth[at_s <= at_s[0] + MOVED_WITHIN_S]))
    rises = bool(smooth.max() - first > first - smooth.min())
    full = find_full_scale(values, unit=unit) if rises else None
    load = estimate_load(smooth, rises=rises, unit=unit, full_scale=full)
    if np.ptp(load) == 0:
        return [], rises
    found = [one for one in find_slow_contacts(at_s, load) if not _explain_course(at_s, load, one)]
    raw = estimate_load(values, rises=rises, unit=unit, full_scale=full)
    return [_move_to_peak(one, time_s, raw, near_s=MEDIAN_CELLS * cell_s) for one in found], rises


def _move_to_peak(
    one: SlowContact, time_s: FloatArray, load: FloatArray, *, near_s: float
) -> SlowContact:
    """Return a contact whose hold begins at the largest reading, or knee, which smoothing moves."""
    is_near = np.abs(time_s - one.start_s) <= near_s
    near = np.flatnonzero(is_near & (time_s >= one.onset_s) & (time_s <= one.end_s))
    if near.size < 3:
        return one
    at_s, height = time_s[near], load[near]
    if not one.relaxes:
        if near_s < COARSE_S:
            return one
        height = height - np.interp(at_s, at_s[[0, -1]], height[[0, -1]])
    return replace(one, start_s=float(at_s[np.argmax(height)]))


def _explain_course(at_s: FloatArray, load: FloatArray, one: SlowContact) -> str:
    inside = (at_s >= one.start_s) & (at_s <= one.end_s - OPENING_S)
    rise = float(np.ptp(load[(at_s >= one.onset_s) & (at_s <= one.end_s)]))
    return _explain_path(load[inside], still=STILL_FRACTION * rise)


def _find_load_side(outline: ContactOutline, unit: str | None) -> tuple[bool, bool]:
    """Return whether load raises the reading, and whether the recording begins loaded."""
    first, bottom, top = outline.stretches[0].level, outline.height.min(), outline.height.max()
    # The recording begins at rest, so the extreme farther from its first level is load.
    begins_low = bool(top - first > first - bottom)
    middle = 0.5 * (bottom + top)
    levels = np.array([s.level for s in outline.stretches if s.end_s - s.begin_s >= MIN_LEVEL_S])
    low, high = levels[levels < middle], levels[levels >= middle]
    if unit == "percent":
        # A relative change is 0 at rest.
        low_rests = bool(abs(bottom) < abs(top))
        return low_rests, begins_low != low_rests
    if unit == "ohm" and begins_low and min(low.size, high.size) >= 2:
        # Load lowers the resistance of every known sheet. The recording begins under load if its
        # low levels scatter as touches do.
        began_loaded = bool(np.ptp(low) > SCATTER_RATIO * np.ptp(high))
        return not began_loaded, began_loaded
    return begins_low, False


def _find_loading_end_s(
    stretch: Stretch, height: FloatArray, *, time_s: FloatArray, per_knee: float
) -> float:
    """Return the end of loading, estimated from the knee of the loading curve.

    `height`, shape (n_times,): rises under load.
    """
    until_s = min(stretch.end_s, stretch.onset_s + LOADING_S)
    first = max(0, int(np.searchsorted(time_s, stretch.onset_s)) - 1)
    stop = int(np.searchsorted(time_s, until_s, side="right"))
    at_s, risen = time_s[first:stop], height[first:stop]
    # An actuation spike first moves the reading away from load; loading begins at its peak.
    peak = int(np.argmin(risen[: max(1, int(np.searchsorted(at_s, stretch.begin_s)))]))
    at_s, risen = at_s[peak:], risen[peak:]
    if at_s.size < 3:
        return float(at_s[-1])
    chord = risen[0] + (risen[-1] - risen[0]) * (at_s - at_s[0]) / (at_s[-1] - at_s[0])
    knee_s = float(at_s[int(np.argmax(risen - chord))])
    return min(float(at_s[0]) + per_knee * (knee_s - float(at_s[0])), stretch.end_s)


def _explain_refusal(
    stretch: Stretch, last: Stretch, outline: ContactOutline, start_s: float, *, time_s: FloatArray
) -> str:
    """Explain why a stretch after contact is not a hold; empty for a hold."""
    held_s = stretch.end_s - start_s
    readings = int(np.searchsorted(time_s, stretch.end_s, side="right")) - int(
        np.searchsorted(time_s, start_s)
    )
    if stretch.end_s - stretch.onset_s < SHORTEST_HOLD_S or held_s < SHORTEST_HOLD_S / 2:
        return _TOO_SHORT
    if readings < MIN_READINGS:
        return _TOO_FEW
    if not _is_still_before(stretch, last, outline):
        return "the reading already moves before the contact"
    return _explain_unsettled(stretch, outline, start_s)


def _is_still_before(stretch: Stretch, last: Stretch, outline: ContactOutline) -> bool:
    """Return whether the reading is steady before the contact.

    At the beginning of a recording, a steady stretch is not required.
    """
    if last.onset_s < last.begin_s and last.end_s - last.begin_s < MIN_LEVEL_S:
        return False
    at_s = outline.time_s
    before = (at_s >= max(last.begin_s, last.end_s - 1.0)) & (at_s < stretch.onset_s)
    moved = float(np.ptp(outline.height[before])) if before.any() else 0.0
    contact_step = abs(stretch.level - stretch.before)
    return moved <= STILL_BEFORE_FRACTION * contact_step + 4.0 * outline.noise


def _explain_unsettled(stretch: Stretch, outline: ContactOutline, start_s: float) -> str:
    """Return the reason why a hold doesn't settle; empty if it settles."""
    inside = (outline.time_s >= start_s) & (outline.time_s <= stretch.end_s - OPENING_S)
    still = STILL_FRACTION * abs(stretch.level - stretch.before) + 4.0 * outline.noise
    return _explain_path(outline.height[inside], still=still)


def _explain_path(height: FloatArray, *, still: float) -> str:
    """Return the reason why readings don't settle; empty if they settle.

    `still`: change that counts as none.
    """
    parts = np.array_split(height, SETTLING_PARTS)
    path = np.diff([np.median(part) for part in parts if part.size])
    third = path.size // 3
    early, late = abs(float(path[:third].sum())), abs(float(path[-third:].sum()))
    if late > max(still, SLOWING_FRACTION * early):
        return "the reading keeps changing instead of settling"
    if min(path[path > 0].sum(), -path[path < 0].sum()) > 2.0 * still:
        return "the reading rises and falls instead of settling"
    return ""
