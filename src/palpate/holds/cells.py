"""Cells with a number and its unit, such as ``6.2 kΩ``, and columns of signs and units."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds.columns import (
    find_named_unit,
    is_load,
    names_sensor,
    split_words,
    time_unit_of,
    unit_of,
)
from palpate.holds.decimals import is_missing, is_number, split_cell
from palpate.holds.units import PER_SECOND, PREFIXES, TIME_UNITS, find_unit

#: Quantity (None for those without a reading's unit, "" for a prefix alone) and factor.
_Factor = tuple[str | None, float]
#: Basic unit of each quantity, as a column's name has it.
_BASIC = {"ohm": "Ohm", "percent": "%", "volt": "V", "newton": "N", "pascal": "Pa", "time": "s"}
#: Names of a column with the units of the numbers in the column before it.
_UNIT_NAMES = {"unit", "units", "einheit", "einheiten"}
#: Up to this fraction of rows with a unit are notes.
_NOTES = 0.01


def _factor_of(unit: str, *, prefix_first: bool = False) -> _Factor | None:
    known = find_unit(unit)
    if unit in PREFIXES and (prefix_first or known is None):
        return "", PREFIXES[unit]
    if known is not None:
        return known.quantity, known.factor
    per_second = PER_SECOND.get(TIME_UNITS.get(unit.lower(), ""))
    return None if per_second is None else ("time", 1.0 / per_second)


@dataclass(slots=True, kw_only=True)
class CellUnits:
    """The units in the cells of one column, and their rows."""

    column: str
    rows: dict[str, list[int]] = field(default_factory=dict)

    def split(
        self, fields: Mapping[int, str], *, parse: Callable[[Sequence[str]], FloatArray]
    ) -> dict[int, float]:
        """Return the numbers of the fields that have one with a unit, by row; none if few have.

        `fields`: texts by row. `parse`: the file's format of numbers.
        """
        found: dict[int, str] = {}
        rows: dict[str, list[int]] = {}
        for row, text in fields.items():
            cell = split_cell(text)
            # A label such as "10 mm" may name a sensor.
            if cell is None or (names_sensor(self.column) and not _is_reading(cell[1])):
                continue
            rows.setdefault(cell[1], []).append(row)
            found[row] = cell[0]
        # Some hexadecimal numbers end with the letter of a unit.
        if 2 * len(found) < len(fields):
            return {}
        for unit, each in rows.items():
            self.rows.setdefault(unit, []).extend(each)
        return dict(zip(found, parse([*found.values()]).tolist(), strict=True))

    def convert(self, numbers: FloatArray, *, place: Callable[[int], str], name: str) -> str:
        """Convert the numbers to one unit in place; return the column's name with it.

        Cells that all have the same unit keep it. Plain numbers are possible next to cells with a
        prefix alone, or in a column whose name has a unit.

        Raises `InputError` if the units can't be converted, or only some cells have one.
        """
        usual, stated = unit_of(self.column), find_named_unit(self.column)
        found = {
            unit: _factor_of(unit, prefix_first=usual is not None) or ("", 1.0)
            for unit in self.rows
        }
        kinds = {kind for kind, _ in found.values() if kind != ""}
        quantity: str | None = usual if usual in kinds or not kinds else None
        scale = 1.0
        if stated is not None:
            quantity, scale = stated.quantity, stated.factor
        elif time_unit_of(self.column):
            quantity = "time"
            scale = 1.0 / PER_SECOND.get(time_unit_of(self.column) or "", 1.0)
        with_unit = np.concatenate([np.array(rows) for rows in self.rows.values()])
        is_plain = np.isfinite(numbers) & (numbers != 0.0)
        is_plain[with_unit] = False
        is_unclear = bool(kinds) and quantity is None and is_plain.any()
        is_note = usual is None and not is_load(self.column)
        if (is_unclear or is_note) and with_unit.size <= _NOTES * numbers.size:
            numbers[with_unit] = np.nan
            return self.column
        one, row = next((unit, rows[0]) for unit, rows in self.rows.items())
        where = f"{name} {place(row)}"
        words = self.column.strip("~<>≈ ").split(" ")
        if any(split_cell(" ".join(words[-size:])) for size in (1, 2)):
            raise InputError(
                f"{name}: {self.column!a} above {place(row)} is not a number with a unit, nor a "
                "name; correct it"
            )
        if is_unclear:
            plain = int(np.flatnonzero(is_plain)[0])
            raise InputError(
                f"{where}: a cell in {one!a}, but {numbers[plain]:g} ({place(plain)}) in column "
                f"{self.column} has no unit; write the unit in each cell, or only in the header"
            )
        if len(found) == 1 and quantity is None and kinds:
            return self._name_with(one, is_time=kinds == {"time"})
        has_prefix = len(kinds) < len({kind for kind, _ in found.values()})
        is_same = len(kinds | ({quantity} - {None})) <= 1 and None not in kinds
        if not is_same or (has_prefix and scale != 1.0):
            listed = ", ".join(map(ascii, [*self.rows][:4]))
            raise InputError(
                f"{where}: the cells of column {self.column} have the units {listed}, which can't "
                "be converted to one; write one unit in the header"
            )
        for unit, rows in self.rows.items():
            numbers[rows] *= found[unit][1] / scale
        if quantity is not None or not kinds:
            return self.column
        (kind,) = kinds
        return self._name_with(_BASIC.get(f"{kind}", f"{kind}"), is_time=kind == "time")

    def _name_with(self, unit: str, *, is_time: bool) -> str:
        name = f"{self.column} [{unit}]"
        return f"time {name}" if is_time and time_unit_of(name) is None else name


def _is_reading(unit: str) -> bool:
    known = find_unit(unit)
    return known is not None and known.quantity is not None


def join_parts(texts: dict[str, list[str]], *, mark: str) -> None:
    """Join columns of signs or units with the column of their numbers.

    `texts`: the chunks of each column, with `mark` between the cells. Changed in place.
    """
    for name in [*texts]:
        is_unnamed = name.isdigit() or name.startswith("column ")
        if not (is_unnamed or _UNIT_NAMES & {*split_words(name)}):
            continue
        cells = {*texts[name][0].split(mark)} - {""}
        names = [*texts]
        place = names.index(name)
        if is_unnamed and "+" in cells and cells <= {"+", "-"} and place + 1 < len(names):
            target, form = names[place + 1], "{1}{0}"
        elif cells and all(not is_number(cell) and _factor_of(cell) for cell in cells):
            if len({(_factor_of(cell) or ("", 1.0))[0] for cell in cells}) > 1:
                # The rows have several quantities, which another column names.
                continue
            beside = [names[at] for at in (place - 1, place + 1) if 0 <= at < len(names)]
            numbers = [one for one in beside if _is_numeric(texts[one][0].split(mark))]
            target = next((one for one in numbers if time_unit_of(one) is None), "")
            form = "{0} {1}"
        else:
            continue
        if target:
            texts[target] = [
                mark.join(
                    cell if is_missing(cell) else form.format(cell, part)
                    for cell, part in zip(each.split(mark), parts.split(mark), strict=True)
                )
                for each, parts in zip(texts[target], texts[name], strict=True)
            ]
            del texts[name]


def _is_numeric(cells: Sequence[str]) -> bool:
    return sum(map(is_number, cells)) > 0.5 * sum(not is_missing(cell) for cell in cells)
