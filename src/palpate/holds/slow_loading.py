"""Contacts whose loading takes a second or more, such as those of a testing machine.

`contacts` recognises a contact by its speed. A slow loading is recognised by its course: the load
leaves its level at rest, rises steadily to a peak or a knee, and then settles for at least as long.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from palpate.arrays import FloatArray

#: Shortest slow loading, seconds. The knee of a faster one is found by `contacts`.
SLOW_LOADING_S = 0.8
#: First window in which the end of the loading is sought, seconds, its growth while the loading
#: lasts, and its largest length.
FIRST_WINDOW_S, GROWTH, LAST_WINDOW_S = 1.0, 1.5, 60.0
#: A loading lasts while the load rises, in the last fifth of the window, by more than this
#: fraction of its mean rate.
LASTS_FRACTION = 0.25
#: Fall of the load after its peak, as a fraction of its rise, that shows relaxation: then the hold
#: begins at the peak instead of the knee.
RELAXED_FRACTION = 0.07
#: Part of a contact in which the peak is sought: this many windows and seconds.
PEAK_WINDOWS, PEAK_S = 1.5, 2.0
#: Load above which a contact is sought, and above which it begins, as fractions of the range.
TOUCHED_FRACTION, ONSET_FRACTION = 0.1, 0.05
#: Largest total fall during the loading, as a fraction of its rise.
FALL_FRACTION = 0.2
#: Fraction of the level of the hold below which the load is being removed.
RELEASED_FRACTION = 0.8
#: Largest rise and fall during a hold, as a fraction of the rise during loading. A hold has one of
#: them: it relaxes or creeps.
WAVE_FRACTION = 0.1
#: Shortest hold after slow loading, seconds.
SHORTEST_S = 3.0
#: Usual ranges of converters, counts, and supplies, volts.
_CONVERTERS, _SUPPLIES_V = (1024.0, 4096.0, 16384.0, 32768.0, 65536.0), (3.3, 5.0)
#: Fraction of the range below which a divider is almost linear.
NEAR_FRACTION = 0.4
#: Duration at the beginning of a recording whose median is the level at rest, seconds.
REST_S = 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class SlowContact:
    """A contact after slow loading."""

    #: Begin and end of the loading, and end of the hold.
    onset_s: float
    start_s: float
    end_s: float
    #: Whether the hold begins at a peak of the load.
    relaxes: bool


def find_full_scale(values: FloatArray, *, unit: str | None) -> float | None:
    """Return the reading of a divider at zero resistance, or None if the reading isn't near it.

    Readings of a fixed resistor in series with the sensor approach the supply under load. A
    converter's range is recognised from counts or whole numbers.

    >>> find_full_scale(np.array([12.0, 966.0]), unit="counts")
    1024.0
    >>> find_full_scale(np.array([0.2, 0.9]), unit="volt") is None
    True
    """
    highest = float(values.max(initial=0.0))
    is_counts = unit == "counts" or (unit is None and bool((values == np.rint(values)).all()))
    ranges = _CONVERTERS if is_counts else _SUPPLIES_V if unit == "volt" else ()
    full = next((one for one in ranges if highest < one), None)
    return full if full is not None and highest > NEAR_FRACTION * full else None


def estimate_load(
    values: FloatArray, *, rises: bool, unit: str | None, full_scale: float | None = None
) -> FloatArray:
    """Return a quantity roughly proportional to the load, in an arbitrary unit.

    A resistance is roughly inverse to the load; other readings that fall under load are reversed.

    `full_scale`: of a divider (`find_full_scale`), whose readings rise ever more slowly with the
        load.

    >>> estimate_load(np.array([2.0, 4.0]), rises=False, unit="ohm").tolist()
    [0.5, 0.25]
    >>> estimate_load(np.array([256.0, 512.0]), rises=True, unit="counts", full_scale=1024).round(
    ...     2
    ... ).tolist()
    [0.33, 1.0]
    """
    if rises and full_scale is not None:
        return np.asarray(values / (full_scale - values))
    if rises:
        return values
    ratio = 1.0 + values / 100.0 if unit == "percent" else values
    return 1.0 / ratio if ratio.min() > 0 else -values


def find_slow_contacts(time_s: FloatArray, load: FloatArray) -> list[SlowContact]:
    """Find the contacts with slow loading and a hold after it.

    `time_s`, `load`, shape (n_cells,): smoothed load (`estimate_load`), which begins at rest.

    >>> time_s = np.arange(0, 20, 0.1)
    >>> load = np.clip(time_s - 2, 0, 4) - 0.5 * np.log1p(np.maximum(time_s - 6, 0))
    >>> [(round(one.onset_s), round(one.start_s), round(one.end_s))
    ...     for one in find_slow_contacts(time_s, load)]
    [(2, 6, 20)]
    """
    rest = float(np.median(load[time_s <= time_s[0] + REST_S]))
    risen = load - rest
    top = float(risen.max())
    touched = np.concatenate(([0], risen > TOUCHED_FRACTION * top, [0])).astype(np.int8)
    edges = np.diff(touched)
    # Index of the last cell at rest up to each cell; 0 before the first.
    low = np.maximum.accumulate(np.where(risen <= ONSET_FRACTION * top, np.arange(risen.size), 0))
    found, last = list[SlowContact](), 0
    for begin, stop in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        inside = slice(max(int(low[max(int(begin) - 1, 0)]), last), int(stop))
        last = int(stop)
        if time_s[last - 1] - time_s[inside.start] < SHORTEST_S:
            continue
        one = _follow(time_s[inside], risen[inside], is_open=bool(stop < risen.size))
        if one is not None and one.end_s - one.start_s >= max(
            SHORTEST_S, one.start_s - one.onset_s
        ):
            found.append(one)
    return found


def _follow(time_s: FloatArray, risen: FloatArray, *, is_open: bool) -> SlowContact | None:
    """Return the contact of an excursion from rest, or None without a slow, steady loading.

    `is_open`: whether the excursion ends before the recording.
    """
    start, relaxes = _find_loading_end(time_s, risen)
    if time_s[start] - time_s[0] < SLOW_LOADING_S:
        return None
    changes = np.diff(risen[: start + 1])
    rise = float(risen[start] - risen[0])
    if -float(changes[changes < 0].sum()) > FALL_FRACTION * rise:
        return None
    after = risen[start:]
    level = float(np.median(after[after.size // 3 : max(1, 2 * after.size // 3)]))
    last = risen.size - 1
    if is_open:
        last = int(np.flatnonzero(risen >= RELEASED_FRACTION * level)[-1])
    held = risen[start : last + 1]
    if held.size < 2:
        return None
    up = float(np.max(held - np.minimum.accumulate(held)))
    down = float(np.max(np.maximum.accumulate(held) - held))
    if min(up, down) > WAVE_FRACTION * rise:
        return None
    return SlowContact(
        onset_s=float(time_s[0]),
        start_s=float(time_s[start]),
        end_s=float(time_s[last]),
        relaxes=relaxes,
    )


def _find_loading_end(time_s: FloatArray, risen: FloatArray) -> tuple[int, bool]:
    """Return the index of the peak and True, or of the knee and False."""
    since_s = time_s - time_s[0]
    until_s = FIRST_WINDOW_S
    while until_s < min(LAST_WINDOW_S, float(since_s[-1])):
        inside = since_s <= until_s
        late = inside & (since_s >= 0.8 * until_s)
        rate = float(np.polyfit(since_s[late], risen[late], 1)[0]) if late.sum() > 1 else np.inf
        if rate * until_s <= LASTS_FRACTION * float(np.ptp(risen[inside])):
            break
        until_s *= GROWTH
    # The window may end before the peak if the reading rises ever more slowly with the load.
    soon = risen[since_s <= PEAK_WINDOWS * until_s + PEAK_S]
    peak = int(np.argmax(soon))
    if soon[peak] - soon[-1] > RELAXED_FRACTION * (soon[peak] - soon[0]):
        return peak, True
    inside = since_s <= until_s
    at_s, course = since_s[inside], risen[inside]
    chord = course[0] + (course[-1] - course[0]) * at_s / max(float(at_s[-1]), 1e-9)
    return int(np.argmax(course - chord)), False
