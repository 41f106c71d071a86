"""Results as a pandas data frame: estimates, traces, readings, grasps, tables and holds.

The fields of a result are its columns, whatever its type; a recording has those of its export. So
results stay plain, and pandas is imported only here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from palpate.errors import InputError, require_extra
from palpate.measurement import Measurement
from palpate.recording.contents import Recording
from palpate.recording.exporting import tabulate_frames

if TYPE_CHECKING:
    import pandas as pd


def to_dataframe(found: Any) -> pd.DataFrame:
    """Return a result, or several of one kind, as a data frame.

    A trace, a hold and a batch of estimates have a row for each element of their arrays, one
    estimate, one reading and one grasp a single row. A `Measurement` becomes its value (NaN if only
    a bound is known), ``_low``, ``_high`` and ``_status``. Pixels become columns, such as
    ``r0c1_resistance_ohm``. A recording has the columns of `palpate export`.

    Parameters
    ----------
    found : result, or iterable of results
        `SettledEstimate`, `Measurement`, `Reading`, `GraspResult`, `Grip`, `ScoreTable`, `Hold`,
        `ReadingTable`, a recording, or what `FittedForce.force` returns.

    Raises
    ------
    InputError
        If it is none of these.
    MissingExtraError
        If pandas is not installed.

    Examples
    --------
    >>> import palpate
    >>> fitted = palpate.fit_force({"load_n": [0, 1.0, 4.0, 9.0], "R_ohm": [9e3, 1e3, 300, 150]})
    >>> table = to_dataframe(fitted.force({"R_ohm": [9000.0, 500.0]}))
    >>> list(table), len(table)
    (['name', 'time_s', 'force_n', 'low_n', 'high_n', 'load_n'], 2)
    """
    with require_extra("a data frame", extra="data"):
        import pandas as pd
    if isinstance(found, Recording):
        return pd.DataFrame(tabulate_frames(found))
    return pd.DataFrame([*_list_rows(found)])


def _list_rows(found: Any) -> Iterator[dict[str, Any]]:
    """Yield a mapping for each row."""
    if is_dataclass(found) and not isinstance(found, type | Iterable):
        yield from _list_records(found)
    elif isinstance(found, Mapping):
        yield dict(found)
    elif isinstance(found, Iterable) and not isinstance(found, str | bytes | np.ndarray):
        for one in found:
            yield from _list_rows(one)
    elif is_dataclass(getattr(found, "result", None)):
        yield from _list_records(found.result)
    else:
        raise InputError(
            f"a {type(found).__name__} is no result; pass an estimate, a trace, readings, a grasp "
            "or a table"
        )


def _list_records(found: Any) -> Iterator[dict[str, Any]]:
    """Yield a mapping for each element of the arrays of a result; one without a time's array."""
    if isinstance(found, Measurement):
        low, high = found.known_ends
        status = str(found.status)
        yield {"value": found.value, "low": low, "high": high, "unit": found.unit, "status": status}
        return
    parts = {part.name: getattr(found, part.name) for part in fields(found)}
    lead = parts.get("time_s", parts.get("value"))
    rows = len(lead) if isinstance(lead, np.ndarray) and lead.ndim else None
    columns = dict[str, Any]()
    for name, value in parts.items():
        columns |= _expand(name, value, rows=rows)
    if rows is None:
        yield columns
        return
    for row in range(rows):
        yield {
            name: value[row] if isinstance(value, np.ndarray) else value
            for name, value in columns.items()
        }


def _expand(name: str, value: Any, *, rows: int | None) -> dict[str, Any]:
    """Return the columns of one field: arrays of `rows` elements, and plain values for all rows."""
    if isinstance(value, Measurement):
        low, high = value.known_ends
        ends = {f"{name}_low": low, f"{name}_high": high, f"{name}_status": str(value.status)}
        return {name: value.value, **ends}
    if isinstance(value, np.ndarray):
        pixels = value if rows is None else np.moveaxis(value, 0, -1)
        if rows is not None and (not value.ndim or len(value) != rows):
            return {}
        if pixels.ndim - (rows is not None) == 2:
            cells = np.ndindex(pixels.shape[:2])
            return {f"r{row}c{col}_{name}": pixels[row, col] for row, col in cells}
        return {name: value} if rows is None or value.ndim == 1 else {}
    if isinstance(value, Mapping):
        arrays = {key: one for key, one in value.items() if isinstance(one, np.ndarray)}
        return {key: one for key, one in arrays.items() if rows is not None and len(one) == rows}
    if isinstance(value, tuple):
        return {name: ", ".join(map(str, value))} if name == "faults" else {}
    if value is None or isinstance(value, str | int | float | np.generic):
        return {name: str(value) if isinstance(value, str) else value}
    return {}
