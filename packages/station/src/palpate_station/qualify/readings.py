"""Paired readings of the same items by a reference instrument and by grasps."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds.strict import read_table

#: Minimum number of items; with fewer, the intervals are too wide to be useful (assumed).
FEWEST_ITEMS = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class PairedReadings:
    """Readings, one row for each side or repeat of an item.

    Attributes
    ----------
    item : ndarray of int, shape (n_rows,)
        Number of the item, from 0.
    reference, grasp : ndarray, shape (n_rows,)
        Readings of the two instruments, each in its own unit; NaN without a reading.
    """

    item: NDArray[np.intp]
    reference: FloatArray
    grasp: FloatArray

    @property
    def items(self) -> int:
        """Number of items."""
        return int(self.item.max()) + 1 if self.item.size else 0

    @property
    def has_both(self) -> NDArray[np.bool_]:
        """Whether both instruments have a reading in each row, shape (n_rows,)."""
        return np.isfinite(self.reference) & np.isfinite(self.grasp)

    def select(self, chosen: NDArray[np.intp]) -> PairedReadings:
        """Return the readings of these items, in this order; repeats are allowed."""
        order = np.argsort(self.item, kind="stable")
        starts = np.searchsorted(self.item[order], np.arange(self.items + 1))
        rows = [order[starts[item] : starts[item + 1]] for item in chosen]
        item = np.repeat(np.arange(chosen.size), [part.size for part in rows])
        row = np.concatenate(rows)
        return PairedReadings(item=item, reference=self.reference[row], grasp=self.grasp[row])


def read_pairs(path: str | os.PathLike[str]) -> PairedReadings:
    """Read paired readings from a table with columns ``item_id``, ``reference`` and ``grasp``.

    Each row is a side or a repeat. Either reading may be empty. Other columns, such as ``side``,
    are ignored.

    Raises
    ------
    InputError
        If the file can't be read, or fewer than eight items have both readings.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> path = Path(tempfile.mkdtemp()) / "readings.csv"
    >>> rows = "".join(f"A{i},left,{70 + i},{50 + i}\\nA{i},right,{71 + i},\\n" for i in range(9))
    >>> _ = path.write_text("item_id,side,reference,grasp\\n" + rows)
    >>> readings = read_pairs(path)
    >>> readings.items, int(readings.has_both.sum())
    (9, 9)
    """
    columns = read_table(
        path,
        columns={"item_id": "text", "reference": "number or empty", "grasp": "number or empty"},
    )
    _, item = np.unique(columns["item_id"].astype(str), return_inverse=True)
    readings = PairedReadings(item=item, reference=columns["reference"], grasp=columns["grasp"])
    both = np.unique(item[readings.has_both]).size
    if both < FEWEST_ITEMS:
        raise InputError(
            f"{os.fspath(path)}: {both} item(s) with both a reference and a grasp; at least "
            f"{FEWEST_ITEMS} are required"
        )
    return readings
