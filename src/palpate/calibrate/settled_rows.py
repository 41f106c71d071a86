"""Whether rows with loads and times are settled readings under weights, or the log of a load cell.

Both are tables with a clock and a column of loads. The rows of a log are correlated within a
contact, so that each of them is not one more weight. A log that is written faster than
`SLOW_STEP_S` is always one. Of slower rows the loads decide: weights repeat exactly, or are another
one in each row; a load cell reads about the same as a row before, or never the same again.
"""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray

#: Rows that are closer than this are a log, seconds: nobody changes a weight and waits in less.
SLOW_STEP_S = 5.0
_DAY_S = 86_400.0
#: Rows are evenly spaced, as by a timer, if this fraction of the steps is near the usual one.
_EVEN_FRACTION, _NEAR = 0.8, 0.1
#: Ratio of the loads of two rows from which they are two weights.
_OTHER_LOAD_RATIO = 1.1
#: Fraction of the largest load that counts as none.
_NO_LOAD_FRACTION = 0.02
#: Most loads that a person or a machine lays one by one, without any of them twice.
_MOST_WEIGHTS = 40


def explain_rows(
    time_s: FloatArray, load_n: FloatArray, *, is_calendar: bool
) -> tuple[bool, str] | None:
    """Return whether the rows are settled readings, and why; None if they are a fast log.

    `time_s`, `load_n`, shape (n,): NaN where missing.
    `is_calendar`: whether the times are dates, which may be without a time of day.

    >>> minutes = 60.0 * np.arange(6)
    >>> explain_rows(minutes, np.array([0, 1, 2, 4, 2, 1.0]), is_calendar=False)
    (True, 'rows 60 s apart, another load in each')
    >>> explain_rows(minutes, np.array([0, 4.02, 4.01, 4.03, 4.02, 0]), is_calendar=False)
    (False, 'rows 60 s apart, whose loads stay about the same from row to row')
    """
    known = time_s[np.isfinite(time_s)]
    if known.size < 2:
        return True, "a single row with a time"
    steps_s = np.abs(np.diff(known))
    if is_calendar and not (steps_s % _DAY_S).any():
        return True, "dates without a time of day"
    step_s = float(np.median(steps_s))
    if step_s < SLOW_STEP_S:
        return None
    rows = f"rows {step_s:.3g} s apart"
    if np.mean(np.abs(steps_s - step_s) <= _NEAR * step_s) < _EVEN_FRACTION:
        return True, f"{rows} in the median, at uneven times"
    load_n = load_n[np.isfinite(load_n)]
    loaded = load_n > _NO_LOAD_FRACTION * np.max(load_n, initial=0.0)
    both = loaded[1:] & loaded[:-1]
    before, after = load_n[:-1][both], load_n[1:][both]
    is_same, is_near = before == after, np.abs(np.log(after / before)) < np.log(_OTHER_LOAD_RATIO)
    if is_same.any() and (is_same == is_near).all():
        return True, f"{rows}, whose loads repeat exactly"
    if is_near.any() and is_near.sum() >= loaded.sum() / 2:
        return False, f"{rows}, whose loads stay about the same from row to row"
    different = np.unique(load_n[loaded]).size
    if different > _MOST_WEIGHTS:
        return False, f"{rows}, and {different} different loads"
    return True, f"{rows}, another load in each"
