"""Dates and times of day, as loggers and terminals write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError

_DAY_S = 86400.0
_MONTHS = ["jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec"]
_MONTH = r"(?:jan|feb|mar|apr|may|jun|jul|aug|sep|oct|nov|dec)[a-z]*\.?"
_DATE = (
    r"(?:\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[./-]\d{1,2}[./-]\d{4}|\d{1,2}[./-]\d{1,2}[./-]\d{2}"
    rf"|\d{{1,2}}[- _]{_MONTH}[- _]\d{{4}}|\d{{1,2}}-{_MONTH}-\d{{2}}(?!\d)"
    rf"|{_MONTH}[ _]\d{{1,2}},?[ _]\d{{4}}"
    rf"|{_MONTH}[ _]{{1,2}}\d{{1,2}})"
)
#: The days of a time difference, as Python and pandas write it.
_DAYS = r"(?:\d{1,5} days?,? \+?)?"
_TIME = r"(?:\d{1,3}:\d\d[.,]\d{1,6}|\d{1,2}:\d\d(?::\d\d(?:[.,:]\d{1,9})?)?(?: ?[ap]\.?m\b\.?)?)"
_ZONE = r"(?: ?(?:z\b|utc\b|gmt\b|[+-]\d\d:?\d\d\b))?"
_WEEKDAY = r"(?:(?:mon|tue|wed|thu|fri|sat|sun)[a-z]*\.?,? +)?"
#: The form of C's `ctime`, with the year last, and ISO 8601 without separators.
_YEAR_LAST = rf"{_MONTH} +\d{{1,2}} +{_TIME} +\d{{4}}"
_BASIC = r"(?:19|20)\d{6}[t_]\d{6}(?:[.,]\d{1,9})?"
#: A date, a time of day, or both.
MOMENT = (
    rf"(?:{_WEEKDAY}(?:{_YEAR_LAST}|{_BASIC}{_ZONE}|{_DATE}(?:(?:t| +|, *|_|;){_TIME}{_ZONE})?)"
    rf"|{_DAYS}{_TIME}{_ZONE})"
)
_MOMENT = re.compile(MOMENT, re.IGNORECASE)
_RARE = re.compile(
    rf"(?<!\w)(?P<weekday>{_WEEKDAY})(?:(?P<month>{_MONTH}) +(?P<day>\d{{1,2}}) +"
    rf"(?P<time>{_TIME}) +(?P<year>\d{{4}})|(?P<basic>{_BASIC})|(?={_DATE}))",
    re.IGNORECASE,
)
#: Weekday, month or ISO 8601 without separators.
_RARE_HINT = re.compile(r"[^\W\d_]{3}|\d{8}[t_]\d{6}", re.IGNORECASE)
_SPACED = re.compile(rf"(?<!\w)({_DATE})[ t_]+({_TIME})({_ZONE})", re.IGNORECASE)
_MASKED = re.compile(rf"{_SPACED.pattern}|\b{_DAYS[:-1]}{_TIME}", re.IGNORECASE)
_PARTS = re.compile(
    rf"(?P<date>{_DATE})?[t ,_;]*(?P<days>{_DAYS})(?P<time>{_TIME})?(?P<zone>{_ZONE})",
    re.IGNORECASE,
)


def is_moment(text: str) -> bool:
    """Return whether a text is a date, a time of day, or both.

    >>> [is_moment(text) for text in ("31.12.2024 12:30", "12:30:00.5 PM", "12.30")]
    [True, True, False]
    """
    return _MOMENT.fullmatch(text.strip()) is not None


def join_spaced(line: str) -> str:
    """Return a line with dates and times of day joined into one field.

    >>> join_spaced("2024-05-31 12:30:00.5 PM 620")
    '2024-05-31T12:30:00.5PM 620'
    """
    return _SPACED.sub(
        lambda m: f"{m[1].replace(' ', '_')}T{m[2].replace(' ', '')}{m[3].strip()}",
        _rewrite_rare(line),
    )


def _rewrite_rare(text: str) -> str:
    """Return a text without weekdays, and with rare forms of dates in the common one.

    >>> _rewrite_rare("Mon Feb 13 09:58:07 2023 620"), _rewrite_rare("20230213T095807.5")
    ('Feb 13, 2023 09:58:07 620', '2023-02-13T09:58:07.5')
    """
    return _RARE.sub(_common_form, text) if _RARE_HINT.search(text) else text


def _common_form(found: re.Match[str]) -> str:
    if found["month"]:
        return f"{found['month']} {found['day']}, {found['year']} {found['time']}"
    if found["basic"]:
        one = found["basic"]
        return f"{one[:4]}-{one[4:6]}-{one[6:8]}T{one[9:11]}:{one[11:13]}:{one[13:]}"
    return ""


def mask_dates(line: str) -> str:
    """Return a line with dates or days and their times replaced by ``#``.

    >>> mask_dates("31-May-2024 12:30;620")
    '#################;620'
    """
    return _MASKED.sub(lambda m: "#" * len(m[0]), line)


def parse_moments(texts: Sequence[object], *, name: str, file: str) -> NDArray[np.float64] | None:
    """Return seconds since the first moment (NaN for other texts); None if few are moments.

    Times of day may pass midnight, and one o'clock on a clock of 12 hours. A time without a zone is
    used as written; daylight saving time is ignored.

    Raises `InputError` if day and month can't be distinguished.

    >>> parse_moments(["12/31/2024 11:59:59 PM", "01/01/2025 12:00:01 AM"], name="", file="")
    array([0., 2.])
    """
    found = [_PARTS.fullmatch(_rewrite_rare(str(text).strip())) for text in texts]
    parts = [m if m and (m["date"] or m["time"]) else None for m in found]
    if not texts or sum(m is not None for m in parts) <= 0.5 * len(texts):
        return None
    clock_s = np.array([np.nan if m is None else _clock_s(m) for m in parts])
    dates = [None if m is None or not m["date"] else m["date"] for m in parts]
    if any(dates):
        return _add_days(clock_s, dates, name=name, file=file)
    known = np.flatnonzero(np.isfinite(clock_s))
    since = clock_s - clock_s[known[0]]
    steps = np.diff(since[known])
    passed_s = np.zeros(since.size)
    passed_s[known[1:]] = np.where(steps < -0.5 * _DAY_S, _DAY_S, 0.0)
    # A clock of 12 hours without AM and PM continues with 1:00 after 12:59.
    hour = clock_s[known] // 3600.0
    passed_s[known[1:]] += np.where((hour[:-1] == 12) & (hour[1:] == 1), 0.5 * _DAY_S, 0.0)
    return np.asarray(since + np.cumsum(passed_s))


def _clock_s(found: re.Match[str]) -> float:
    days = int(found["days"].split()[0]) if found["days"] else 0
    return _DAY_S * days + _time_s(found["time"], found["zone"])


def _time_s(text: str | None, zone: str) -> float:
    """Return seconds after midnight in UTC, or as written without a zone; NaN if impossible."""
    if not text:
        return 0.0
    digits = re.split(r"[:.,]", re.sub(r"[^\d:.,]", "", text).rstrip(".,"))
    if text.count(":") == 1 and len(digits) > 2:
        # Minutes and seconds, as spreadsheets write short times.
        return 60.0 * int(digits[0]) + float(f"{digits[1]}.{digits[2]}")
    hour, minute, second = (int(part) for part in (*digits, "0", "0")[:3])
    half = text.lower().replace(".", "")
    if half.endswith("m"):
        # Some programs write 14:30 PM.
        hour = hour % 12 + 12 * half.endswith("pm") if hour <= 12 else hour
    if hour > 24 or minute > 59 or second > 60:
        return float("nan")
    fraction = float(f"0.{digits[3]}") if len(digits) > 3 else 0.0
    offset = re.search(r"([+-])(\d\d):?(\d\d)", zone)
    away_s = 0.0
    if offset:
        away_s = 3600.0 * int(offset[2]) + 60.0 * int(offset[3])
        away_s *= -1.0 if offset[1] == "-" else 1.0
    return 3600.0 * hour + 60.0 * minute + second + fraction - away_s


def _add_days(
    clock_s: NDArray[np.float64], dates: Sequence[str | None], *, name: str, file: str
) -> NDArray[np.float64]:
    """Return seconds since the first moment, with the days of its date added."""
    orders = []
    for order in ("as written", "month first"):
        days = {date: _count_days(date, month_first=order != "as written") for date in {*dates}}
        found = np.array([days[date] for date in dates])
        if np.isfinite(found).sum() >= 0.9 * sum(date is not None for date in dates):
            orders.append(_DAY_S * found + clock_s)
    if not orders:
        return np.full(clock_s.size, np.nan)
    steps = [_largest_step_s(moment_s) for moment_s in orders]
    # Dates increase, and a recording has no gap of days: 03/04 then 04/04 are in April.
    good = [moment_s for moment_s, step in zip(orders, steps, strict=True) if step <= _DAY_S]
    chosen = good or orders
    first = [moment_s - moment_s[np.flatnonzero(np.isfinite(moment_s))[0]] for moment_s in chosen]
    if len(first) > 1 and not np.allclose(first[0], first[1], equal_nan=True):
        example = next(date for date in dates if date)
        raise InputError(
            f"{file}: column {name}: {example} may be day/month or month/day; write the dates as "
            "year-month-day"
        )
    return np.asarray(first[0])


def _largest_step_s(moment_s: NDArray[np.float64]) -> float:
    """Return the largest step; infinite if time decreases by a day."""
    steps = np.diff(moment_s[np.isfinite(moment_s)])
    if not steps.size:
        return 0.0
    return float("inf") if steps.min() < -_DAY_S / 2 else float(steps.max())


def _count_days(date: str | None, *, month_first: bool) -> float:
    """Return the days since a fixed day; NaN if there is no such date."""
    if date is None:
        return float("nan")
    word = re.search("|".join(_MONTHS), date.lower())
    numbers = [int(part) for part in re.findall(r"\d+", date)]
    if word:
        month = _MONTHS.index(word[0]) + 1
        year = next((number for number in numbers if number > 31), 2000)
        if len(numbers) == 2 and year == 2000:
            year += numbers[1]
        day = next(number for number in numbers if number <= 31)
    elif numbers[0] > 31:
        year, month, day = numbers
    else:
        day, month, year = numbers
        # Points are European; a date with slashes or hyphens has either order.
        if month_first and "." not in date:
            day, month = month, day
        year += 2000 if year < 100 else 0
    try:
        return (datetime(year, month, day) - datetime(1970, 1, 1)) / timedelta(days=1)
    except ValueError:
        return float("nan")


def parse_datetimes(column: NDArray[Any]) -> NDArray[np.float64]:
    """Return seconds since the first of datetime64 or timedelta64 times; NaN where missing."""
    missing = np.isnat(column)
    first = column[np.argmin(missing)]
    result = (column - first) / np.timedelta64(1, "ns") / 1e9
    return np.where(missing, np.nan, result)
