"""Paired readings of the same items by a reference instrument and by grasps."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError, require_extra
from palpate.holds.strict import Kind, read_table
from palpate_station.store import Store

#: Minimum number of items; with fewer, the intervals are too wide to be useful (assumed).
FEWEST_ITEMS = 8
_COLUMNS: Mapping[str, Kind] = {"item_id": "text", "reference": "number or empty"}


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
    return _pair(read_columns(path, {**_COLUMNS, "grasp": "number or empty"}), path)


def read_columns(path: str | os.PathLike[str], columns: Mapping[str, Kind]) -> dict[str, Any]:
    """Read columns of a table: CSV, Parquet, or the first sheet of an Excel workbook.

    Raises `InputError` as `read_table` does; `MissingExtraError` without python-calamine.
    """
    if Path(path).suffix.lower() not in (".xlsx", ".xlsm", ".xls", ".ods"):
        return read_table(path, columns=columns)
    with require_extra(f"{os.fspath(path)}: Excel", extra="tables", package="palpate-station"):
        from python_calamine import CalamineError, load_workbook
    try:
        with load_workbook(path) as book:
            cells = book.get_sheet_by_index(0).to_python()
    except (CalamineError, OSError) as error:
        raise InputError(f"{os.fspath(path)}: not a complete workbook; save it again") from error
    # A file that the strict reader checks; a workbook has thousands of rows at most.
    with TemporaryDirectory() as folder:
        copy = Path(folder) / Path(path).with_suffix(".csv").name
        with copy.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows([_cell_text(cell) for cell in row] for row in cells)
        try:
            return read_table(copy, columns=columns)
        except InputError as error:
            text = str(error).replace(str(copy), f"{os.fspath(path)}, first sheet,")
            raise InputError(text) from error


def _cell_text(cell: object) -> str:
    # Names such as 17 are numbers in a workbook.
    is_whole = isinstance(cell, float) and cell.is_integer()
    return str(int(cell)) if is_whole and isinstance(cell, float) else str(cell)


def read_pairs_with_store(
    path: str | os.PathLike[str], store: Store, *, measurement: str
) -> tuple[PairedReadings, bool]:
    """Read references from a table, and the grasps of the same items from a store.

    The rows of an item are paired in order with its grasps that have the measurement, oldest first.
    Returns the readings and whether any grasp is simulated. Raises `InputError` as `read_pairs`.
    """
    columns = read_columns(path, _COLUMNS)
    names = [str(name) for name in columns["item_id"]]
    items = list(dict.fromkeys(names))
    taken: dict[str, list[float]] = {}
    simulated = False
    for item, (grasps, _) in zip(items, store.histories(items), strict=True):
        found = [one for one in grasps if one.find_value(measurement) is not None]
        taken[item] = [one.measurements[measurement].middle for one in found]
        simulated = simulated or any(one.is_simulated for one in found)
    rows = {item: iter(values) for item, values in taken.items()}
    grasp = [next(rows[name], math.nan) for name in names]
    # Further grasps count as repeats, without a reference.
    for item, rest in rows.items():
        for value in rest:
            names.append(item)
            grasp.append(value)
    reference = np.append(
        columns["reference"], np.full(len(names) - len(columns["item_id"]), math.nan)
    )
    filled = {"item_id": np.array(names, dtype=object), "reference": reference}
    return _pair(filled | {"grasp": np.array(grasp)}, path), simulated


def _pair(columns: Mapping[str, Any], path: str | os.PathLike[str]) -> PairedReadings:
    _, item = np.unique(columns["item_id"].astype(str), return_inverse=True)
    readings = PairedReadings(item=item, reference=columns["reference"], grasp=columns["grasp"])
    both = np.unique(item[readings.has_both]).size
    if both < FEWEST_ITEMS:
        raise InputError(
            f"{os.fspath(path)}: {both} item(s) with both a reference and a grasp; at least "
            f"{FEWEST_ITEMS} are required"
        )
    return readings
