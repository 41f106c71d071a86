"""Rows of text into columns of numbers, with account of what couldn't be used."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from palpate.errors import InputError
from palpate.holds.form import NO_VALUE
from palpate.holds.table import Table, unique_names, usable

#: Rows that can't be used are left out, and reported, up to this share: a log that begins or ends
#: in the middle of a line, a byte lost on a serial line.
BAD_SHARE = 0.01
_BAD_AT_LEAST = 2


class GatheredRows:
    """Columns under way.

    `names`: one for each column; rows of other lengths can't be used.
    `decimal_comma`: whether numbers have commas for points.
    `word`: what the file calls a row: ``line`` or ``row``.
    """

    def __init__(self, names: Sequence[str], *, decimal_comma: bool, word: str = "line") -> None:
        self._names = unique_names(list(names))
        self._comma = decimal_comma
        self._word = word
        self._pieces: list[list[NDArray[Any]]] = [[] for _ in self._names]
        self._numbers: list[NDArray[np.int64]] = []
        self._bad: list[tuple[int, str]] = []

    def add(self, rows: Sequence[Sequence[str]], *, numbers: Sequence[int]) -> None:
        """Add rows, with the number of each in the file."""
        width = len(self._names)
        if set(map(len, rows)) != {width}:
            kept = [index for index, row in enumerate(rows) if self._fits(row, numbers[index])]
            rows = [rows[index][:width] for index in kept]
            numbers = [numbers[index] for index in kept]
        if not len(rows):
            return
        for pieces, fields in zip(self._pieces, zip(*rows, strict=True), strict=True):
            pieces.append(self._convert(fields))
        self._numbers.append(np.array(numbers, dtype=np.int64))

    def _fits(self, row: Sequence[str], number: int) -> bool:
        width = len(self._names)
        filled = any(field.strip() for field in row)
        if filled and (len(row) < width or any(field.strip() for field in row[width:])):
            self._bad.append((number, f"{len(row)} fields instead of {width}"))
        return filled and len(row) >= width and not any(field.strip() for field in row[width:])

    def _convert(self, fields: Sequence[str]) -> NDArray[Any]:
        """Return numbers where all are, the text itself where not."""
        try:
            if self._comma:
                fields = [field.replace(",", ".") for field in fields]
            if "_" not in "".join(fields):
                return np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
        except ValueError:
            pass
        return np.array(fields, dtype=object)

    def table(self, name: str) -> Table:
        """Return what was gathered.

        Raises `InputError` if there is no row, or more than a few can't be used.
        """
        numbers = np.concatenate(self._numbers) if self._numbers else np.zeros(0, dtype=np.int64)
        left_out = refuse_or_report(
            [(f"{self._word} {number}", what) for number, what in self._bad],
            total=numbers.size + len(self._bad),
            name=name,
        )
        if not numbers.size:
            raise InputError(f"{name}: no rows of numbers in it")
        columns = {}
        for column, pieces in zip(self._names, self._pieces, strict=True):
            columns[column], strange = _join(pieces)
            if strange:
                place = f"{self._word} {numbers[strange[0]]}"
                left_out.append(
                    f"{column}: {len(strange)} fields are not numbers and count as missing (first "
                    f"at {place})"
                )
        return Table(
            name=name,
            columns=columns,
            place=lambda row: f"{self._word} {numbers[row]}",
            left_out=left_out,
        )


def refuse_or_report(bad: Sequence[tuple[str, str]], *, total: int, name: str) -> list[str]:
    """Return a sentence about rows that are left out, where they are few.

    Raises `InputError` if they are many; the message has the first of them.
    """
    if not bad:
        return []
    place, what = bad[0]
    if len(bad) > max(_BAD_AT_LEAST, BAD_SHARE * total):
        raise InputError(
            f"{name} {place}: {what}, and so are {len(bad) - 1} more of {total} rows; fix or "
            "remove them"
            if len(bad) > 1
            else f"{name} {place}: {what}; fix or remove it"
        )
    rows = "1 row was" if len(bad) == 1 else f"{len(bad)} rows were"
    return [f"{rows} left out (first at {place}: {what})"]


def _join(pieces: Iterable[NDArray[Any]]) -> tuple[NDArray[Any], list[int]]:
    """Return one column, and the rows whose text is neither number nor a sign for none."""
    pieces = list(pieces)
    if all(piece.dtype == np.float64 for piece in pieces):
        joined = np.concatenate(pieces)
        joined[~usable(joined)] = np.nan
        return joined, []
    found, texts, strange, at = [], [], [], 0
    for piece in pieces:
        if piece.dtype == np.float64:
            found.append(piece)
        else:
            parsed = np.full(piece.size, np.nan)
            for index, field in enumerate(piece):
                try:
                    parsed[index] = float(field)
                except ValueError:
                    if field.strip().lower() not in NO_VALUE:
                        strange.append(at + index)
            found.append(parsed)
        texts.append(piece.astype(object))
        at += piece.size
    numbers = np.concatenate(found)
    numbers[~usable(numbers)] = np.nan
    if 2 * len(strange) >= at:
        return np.concatenate(texts), []
    return numbers, strange
