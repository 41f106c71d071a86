"""Relative changes of a recording's columns, and their mean: the paper's quantity (equation 1)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.recordings import Readings
from palpate.signal.circuit import resistance_ohm
from palpate.signal.relative import mean_change

#: Name of the column of the mean.
MEAN = "mean change"
#: Fewest readings at rest of each column.
_FEWEST = 3


def relative_readings(readings: Readings, *, rest_s: tuple[float, float], mean: bool) -> Readings:
    """Return a recording as relative changes, percent: of each column, or of all in the mean.

    Parameters
    ----------
    readings : Readings
        In ohm, or in counts with their divider; a unit that isn't known is taken as ohm.
    rest_s : tuple of float
        Beginning and end of a stretch without load, seconds of the recording.
    mean : bool
        Whether to take the mean over all columns (section 2.1). A reading that is missing or open
        is left out of it.

    Raises
    ------
    InputError
        If a column is in another unit, or does not read at rest.

    Examples
    --------
    >>> from palpate.holds.recordings import read_recording
    >>> table = {"time_s": [0, 1, 2, 3], "a": [10, 10, 10, 5.0], "b": [20, 20, 20, 20.0]}
    >>> changed = relative_readings(read_recording(table), rest_s=(0, 2), mean=True)
    >>> changed.columns["mean change"].tolist()
    [0.0, 0.0, 0.0, -25.0]
    """
    begin_s, end_s = rest_s
    at_rest = (readings.time_s >= begin_s) & (readings.time_s <= end_s)
    changes = dict[str, NDArray[np.float64]]()
    for name in readings.columns:
        ohm = _ohm(readings, name)
        rest = ohm[at_rest & np.isfinite(ohm) & (ohm > 0)]
        if rest.size < _FEWEST:
            raise InputError(
                f"{readings.name}: {name}: {rest.size} readings at rest from {begin_s:g} to "
                f"{end_s:g} s, and {_FEWEST} are needed; give another --rest or leave the column "
                "out (--value-column)"
            )
        change = 100.0 * (ohm / np.mean(rest) - 1.0)
        changes[name] = np.where(np.isfinite(change), change, np.nan)
    columns: Mapping[str, NDArray[np.float64]] = changes
    if mean:
        together = np.stack(list(changes.values()), axis=-1)
        columns = {MEAN: np.asarray(mean_change(together[:, None, :]))}
    return replace(readings, columns=columns, units=dict.fromkeys(columns, "percent"), divider=None)


def _ohm(readings: Readings, name: str) -> NDArray[np.float64]:
    unit, values = readings.units[name], readings.columns[name]
    if unit == "counts" and readings.divider is not None:
        return np.asarray(resistance_ohm(values, divider=readings.divider))
    if unit not in (None, "ohm"):
        remedy = "; add --adc-bits, --reference-ohm and --sensor-leg" if unit == "counts" else ""
        raise InputError(
            f"{readings.name}: {name}: --rest makes relative changes of ohm, and this is {unit}"
            + remedy
        )
    return values
