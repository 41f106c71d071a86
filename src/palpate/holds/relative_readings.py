"""Relative changes of a recording's columns, from a stretch without load."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.recordings import ReadingTable
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import mean_change

#: Name of the column with the mean of the relative changes.
MEAN_COLUMN = "mean change"
#: Minimum readings at rest in each column.
_MIN_REST_READINGS = 3


def relative_readings(
    readings: ReadingTable, *, rest_s: tuple[float, float], mean: bool
) -> ReadingTable:
    """Return a recording as relative changes in percent, by column or as their mean.

    Parameters
    ----------
    readings : ReadingTable
        In ohm, or in counts with a divider. A column without a unit is in counts if there is one.
    rest_s : tuple of float
        Start and end of a stretch without load, seconds of the recording.
    mean : bool
        Whether to average over all columns (section 2.1), ignoring missing and open readings.

    Raises
    ------
    InputError
        If a column is in another unit, or has too few readings at rest.

    Examples
    --------
    >>> table = {"time_s": [0, 1, 2, 3], "a_ohm": [9, 9, 9, 4.5], "b_ohm": [20, 20, 20, 20.0]}
    >>> from palpate.holds.recordings import read_recording
    >>> changed = relative_readings(read_recording(table), rest_s=(0, 2), mean=True)
    >>> changed.columns["mean change"].tolist()
    [0.0, 0.0, 0.0, -25.0]
    """
    begin_s, end_s = rest_s
    at_rest = (readings.time_s >= begin_s) & (readings.time_s <= end_s)
    changes = dict[str, NDArray[np.float64]]()
    for name in readings.columns:
        ohm = _column_ohm(readings, name)
        rest = ohm[at_rest & np.isfinite(ohm) & (ohm > 0)]
        if rest.size < _MIN_REST_READINGS:
            raise InputError(
                f"{readings.name}: {name}: {rest.size} readings at rest from {begin_s:g} to "
                f"{end_s:g} s, but {_MIN_REST_READINGS} are needed; change --rest, or exclude the "
                "column with --value-column"
            )
        change = 100.0 * (ohm / np.mean(rest) - 1.0)
        changes[name] = np.where(np.isfinite(change), change, np.nan)
    columns: Mapping[str, NDArray[np.float64]] = changes
    if mean:
        together = np.stack(list(changes.values()), axis=-1)
        columns = {MEAN_COLUMN: np.asarray(mean_change(together[:, None, :]))}
    return replace(readings, columns=columns, units=dict.fromkeys(columns, "percent"), divider=None)


def _column_ohm(readings: ReadingTable, name: str) -> NDArray[np.float64]:
    unit, values = readings.units[name], readings.columns[name]
    if unit in (None, "counts") and readings.divider is not None:
        return np.asarray(resistance_ohm(values, divider=readings.divider))
    circuit = "--adc-bits, --reference-ohm and --sensor-leg"
    if unit is None:
        raise InputError(
            f"{readings.name}: {name}: the unit is unknown, and --rest needs ohms; say --unit ohm, "
            f"or for counts give {circuit}"
        )
    if unit != "ohm":
        remedy = f"; add {circuit}" if unit == "counts" else ""
        raise InputError(
            f"{readings.name}: {name}: --rest converts ohms to relative changes, but the unit is "
            f"{unit}" + remedy
        )
    return values
