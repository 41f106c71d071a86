"""Sensors without a reading at rest, such as an open circuit (OL)."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.holds.contacts import ColumnContacts, find_contacts, log_if_wide
from palpate.holds.table import find_runs

#: Shortest gap that may be rest, seconds.
SHORTEST_GAP_S = 0.3
#: Largest change across a gap, as a fraction of the range, after which the contact continues.
SAME_FRACTION = 0.1
#: Longest gap of lost readings, and part of a gap kept before and after a contact, seconds.
REST_S = 2.0
#: Level at rest: this many times the largest resistance, or ranges beyond the first reading.
OPEN_TIMES = 10.0
#: Readings at each side of a gap that are compared, and fewest readings of a contact.
SIDE, FEWEST = 3, 5


def split_at_open(
    time_s: FloatArray, values: FloatArray, *, unit: str | None
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the stretches between gaps at rest, with rest filled in around them.

    A gap is rest if the meter was above its range (infinity), if it is longer than lost readings
    usually are, or if the readings before and after it differ. A single stretch without gaps is
    returned for other recordings.

    `values`, shape (n_times,): NaN where missing.

    >>> time_s = np.arange(0, 6, 0.1)
    >>> ohm = np.where((time_s > 2) & (time_s < 4), 100.0, np.inf)
    >>> [(found_s, filled)] = split_at_open(time_s, ohm, unit="ohm")
    >>> sorted({*filled.tolist()})
    [100.0, 1000.0]
    """
    finite = np.isfinite(values)
    plain = [(time_s[finite], values[finite])]
    gaps = _find_gaps(time_s, values, finite)
    if not gaps or finite.sum() < FEWEST:
        return plain
    edges = [(0, 0), *gaps, (time_s.size, time_s.size)]
    found = []
    for (before, begin), (end, after) in pairwise(edges):
        inside = np.arange(begin, end)[finite[begin:end]]
        if inside.size < FEWEST:
            continue
        piece = time_s[inside], values[inside]
        # A stretch with its own rest before a contact needs none filled in.
        own = find_contacts(*piece, unit=unit)
        has_rest = bool(own.contacts) and own.contacts[0].onset_s - piece[0][0] >= SHORTEST_GAP_S
        filled = _fill(time_s, values, inside, lead=(before, begin), tail=(end, after), unit=unit)
        # A few readings of the open sensor after a contact look like a contact after rest.
        is_short = not own.began_loaded and _held_s(own) < _held_s(
            find_contacts(*filled, unit=unit)
        )
        if not has_rest or is_short:
            piece = filled
        found.append(piece)
    return found or plain


def _held_s(found: ColumnContacts) -> float:
    """Return the total length of the holds."""
    return sum(one.end_s - one.start_s for one in found.holds)


def _find_gaps(
    time_s: FloatArray, values: FloatArray, finite: NDArray[np.bool_]
) -> list[tuple[int, int]]:
    """Return first row and end of each gap at rest."""
    known = log_if_wide(values[finite])
    if known.size < FEWEST:
        return []
    scaled = np.full(values.size, np.nan)
    scaled[finite] = known
    found = []
    for run in find_runs(finite):
        gap = slice(run.start, run.stop)
        following = min(run.stop, time_s.size - 1)
        if finite[run.start] or time_s[following] - time_s[run.start] < SHORTEST_GAP_S:
            continue
        before = scaled[: gap.start][finite[: gap.start]][-SIDE:]
        after = scaled[gap.stop :][finite[gap.stop :]][:SIDE]
        is_over = bool(np.isposinf(values[gap]).any())
        is_inside = before.size > 0 and after.size > 0
        # A new contact may soon reach the level of the last one: its first reading differs.
        differs = is_inside and float(np.abs(after - np.median(before)).max()) > (
            SAME_FRACTION * float(np.ptp(known))
        )
        is_long = time_s[following] - time_s[run.start] > REST_S
        if is_over or differs or is_long or not is_inside:
            found.append((run.start, run.stop))
    return found


def _fill(
    time_s: FloatArray,
    values: FloatArray,
    inside: NDArray[np.intp],
    *,
    lead: tuple[int, int],
    tail: tuple[int, int],
    unit: str | None,
) -> tuple[FloatArray, FloatArray]:
    """Return a contact with the level at rest before and after it."""
    rows = [row for row in range(*lead) if time_s[row] >= time_s[inside[0]] - REST_S]
    rows += inside.tolist()
    rows += [row for row in range(*tail) if time_s[row] <= time_s[inside[-1]] + REST_S]
    filled = values[rows]
    filled[~np.isfinite(filled)] = _rest_level(values[inside], unit)
    return time_s[rows], filled


def _rest_level(touched: FloatArray, unit: str | None) -> float:
    """Return a reading for a sensor at rest, beyond the readings of a contact."""
    if unit in ("newton", "pascal", "percent"):
        return 0.0
    if unit == "ohm":
        return OPEN_TIMES * float(touched.max())
    # After contact the reading creeps on, away from rest.
    third = max(1, touched.size // 3)
    creeps_up = np.median(touched[-third:]) > np.median(touched[:third])
    span = max(OPEN_TIMES * float(np.ptp(touched)), 0.5 * float(np.abs(np.median(touched))))
    return float(touched[0] - span if creeps_up else touched[0] + span)
