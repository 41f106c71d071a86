"""Read tables of real recordings in runs of rows, and split them into held-out parts."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from palpate.holds.strict import read_table

Item = TypeVar("Item")
Name = TypeVar("Name", bound=Hashable)


def read_runs(
    path: Path, *, keys: Sequence[str], numbers: Sequence[str], text: Sequence[str] = ()
) -> list[dict[str, Any]]:
    """Return each run of consecutive rows with equal keys, as column -> values.

    `numbers` and `text` name the columns to read and include every key.

    Raises
    ------
    InputError
        If the file can't be used.
    """
    columns: dict[str, Any] = {**dict.fromkeys(text, "text"), **dict.fromkeys(numbers, "number")}
    table = read_table(path, columns=columns)
    new = np.any([table[key][1:] != table[key][:-1] for key in keys], axis=0)
    edges = [0, *(np.flatnonzero(new) + 1).tolist(), len(table[keys[0]])]
    return [{name: table[name][a:b] for name in columns} for a, b in pairwise(edges)]


def leave_out(
    items: Sequence[Item], by: Callable[[Item], Name]
) -> list[tuple[Name, list[Item], list[Item]]]:
    """Return each name with the other names' items and its own items.

    Examples
    --------
    >>> leave_out(["a1", "b1", "a2"], lambda item: item[0])
    [('a', ['b1'], ['a1', 'a2']), ('b', ['a1', 'a2'], ['b1'])]
    """
    return [
        (name, [one for one in items if by(one) != name], [one for one in items if by(one) == name])
        for name in dict.fromkeys(map(by, items))
    ]
