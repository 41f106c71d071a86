"""Compare the results of two versions of the code, by station and day."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate_archive.catalogue import Catalogue, list_kinds
from palpate_archive.evaluating import MARK
from palpate_archive.folders import Folder
from palpate_archive.layout import read_metadata

#: Columns that identify a row of results.
_KEYS = ("recording", "hold_id", "channel", "cutoff_s", "time_s")
_B = " of B"


@dataclass(frozen=True, slots=True, kw_only=True)
class DayChange:
    """What changed in one job's results of a station and day, from A to B."""

    job: str
    station: str
    day: str
    #: Rows in both, and in one of them alone.
    both: int
    only_a: int
    only_b: int
    #: Rows of both with any other value, beyond rounding.
    changed: int
    #: Rows of both whose value in B lies outside the interval of A.
    outside: int
    #: Median and largest change of the changed values, percent of the value in A.
    median_percent: float | None
    largest_percent: float | None


def compare_results(a: Folder, b: Folder) -> Iterator[DayChange]:
    """Yield the changes of each job, station and day that A or B contains.

    Raises `InputError` if they have no job in common.
    """
    kinds = [list_kinds(folder) for folder in (a, b)]
    common = sorted(set(kinds[0]) & set(kinds[1]))
    if not common:
        has = " and ".join(
            f"{folder.address} contains {', '.join(names) or 'no results'}"
            for folder, names in zip((a, b), kinds, strict=True)
        )
        raise InputError(f"no job in common: {has}")
    for job in common:
        days = [_group_days(folder, job) for folder in (a, b)]
        for place in sorted(days[0].keys() | days[1].keys()):
            tables = [
                [folder.read_table(file) for file in found.get(place, [])]
                for folder, found in zip((a, b), days, strict=True)
            ]
            yield DayChange(job=job, station=place[0], day=place[1], **_compare_rows(*tables))


def read_versions(results: Folder) -> list[dict[str, str]]:
    """Return the versions of the code that computed the results, in most cases one."""
    found = list[dict[str, str]]()
    for job in list_kinds(results):
        for entry in Catalogue(results, job).files():
            code = read_metadata(results, entry.file)[MARK]["code"]
            if code not in found:
                found.append(code)
    return found


def _group_days(folder: Folder, job: str) -> dict[tuple[str, ...], list[str]]:
    """Return station and day -> files."""
    found = groupby(Catalogue(folder, job).files(), key=lambda entry: entry.part[1:3])
    return {place: [entry.file for entry in entries] for place, entries in found}


def _compare_rows(a: Sequence[Any], b: Sequence[Any]) -> dict[str, Any]:
    """Return the counts and percentages of the tables of a day, of which one may have none."""
    empty = [*a, *b][0].slice(0, 0)
    one, two = (pa.concat_tables([empty, *each]) for each in (a, b))
    keys = [name for name in _KEYS if name in one.column_names]
    both = one.join(two, keys, join_type="inner", right_suffix=_B)
    is_changed = np.zeros(both.num_rows, dtype=bool)
    for name in set(one.column_names) - set(keys):
        is_changed |= _differ(both[name], both[name + _B])
    value = "force_n" if "force_n" in one.column_names else "value"
    bounds = ("low", "high") if value == "value" else (f"{value}_low", f"{value}_high")
    before, after, low, high = (both[name].to_numpy() for name in (value, value + _B, *bounds))
    # Where a value is missing, it has neither an interval nor a relative change.
    has_moved = _differ(both[value], both[value + _B]) & np.isfinite(after - before) & (before != 0)
    percent = 100 * np.abs((after - before)[has_moved] / before[has_moved])
    return {
        "both": both.num_rows,
        "only_a": one.num_rows - both.num_rows,
        "only_b": two.num_rows - both.num_rows,
        "changed": int(is_changed.sum()),
        "outside": int(((after < low) | (after > high)).sum()),
        "median_percent": float(np.median(percent)) if percent.size else None,
        "largest_percent": float(np.max(percent)) if percent.size else None,
    }


def _differ(a: Any, b: Any) -> NDArray[np.bool_]:
    """Return where two columns differ; missing numbers are equal."""
    left, right = a.to_numpy(), b.to_numpy()
    if pa.types.is_string(a.type):
        return np.asarray(left != right, dtype=bool)
    # Holds in one file share their sums, so joining files changes the last bits.
    is_close = np.isclose(left, right, rtol=1e-9, atol=0.0, equal_nan=True)
    return np.asarray(~is_close, dtype=bool)
