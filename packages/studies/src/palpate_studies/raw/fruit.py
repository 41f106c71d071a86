"""Convert grasps until rupture from github.com/SheepLiu712/FruitRuptureEstimate."""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_studies.raw.clone import Clone, parse_numbers, write_table

BANANA, KIWI, MANGO = "banana/trainingSet/", "kiwi/trainingSet/", "mango/trainingSet/"
#: Motor counts per millimetre of closure.
_COUNTS_PER_MM = 95.4929

#: Fruit, time (NaN if not recorded), closure mm, force N, rupture force N.
Grasp: TypeAlias = tuple[str, FloatArray, FloatArray, FloatArray, float]


def write_fruit(clone: Clone, out: Path) -> list[tuple[str, int]]:
    """Write `fruit_rupture.csv.gz` and its index; return the files with row counts."""
    curves, index = [], []
    number: dict[str, int] = {}
    for fruit, time_s, closure_mm, force_n, rupture_n in (
        *_read_bananas(clone),
        *_read_kiwis(clone),
        *_read_mangos(clone),
    ):
        number[fruit] = number.get(fruit, 0) + 1
        name = f"{fruit}-{number[fruit]:02d}"
        index.append((name, fruit, len(force_n), round(rupture_n, 4)))
        curves += [
            (name, "" if np.isnan(t) else round(float(t), 5), round(float(c), 5), float(f))
            for t, c, f in zip(time_s, closure_mm, force_n, strict=True)
        ]
    files = (
        ("fruit_rupture.csv.gz", ("grasp_id", "time_s", "closure_mm", "force_n"), curves),
        ("fruit_rupture_index.csv", ("grasp_id", "fruit", "samples", "rupture_force_n"), index),
    )
    return [(name, write_table(out / name, columns, rows)) for name, columns, rows in files]


def _read_bananas(clone: Clone) -> Iterator[Grasp]:
    names = clone.under(f"{BANANA}data_", ending=".npy")
    for name in sorted(names, key=lambda name: int(name.rsplit("_", 1)[-1].removesuffix(".npy"))):
        position, force_n = _load_array(clone, name)[:, :2].T
        label_name = name.replace("data_", "label_")
        if label_name not in clone.names:
            continue
        label = _load_array(clone, label_name).ravel()
        known = (label > 0) & (force_n > 0)
        if not known.any():
            continue
        time_s = np.full(len(force_n), np.nan)
        rupture_n = float(np.mean(force_n[known] / label[known]))
        yield "banana", time_s, position / _COUNTS_PER_MM, force_n, rupture_n


def _read_kiwis(clone: Clone) -> Iterator[Grasp]:
    for name in clone.under(KIWI, ending=".csv"):
        folder = name.rsplit("/", 1)[0]
        label = f"{folder}/break_force.npy"
        rows = parse_numbers(clone.read(name), columns=3, separator=",")
        if label not in clone.names or not len(rows):
            continue
        time_s, position, force_n = rows.T
        rupture_n = float(_load_array(clone, label).ravel()[0])
        yield "kiwi", time_s - time_s[0], position / _COUNTS_PER_MM, force_n, rupture_n


def _read_mangos(clone: Clone) -> Iterator[Grasp]:
    for name in clone.under(f"{MANGO}data/", ending=".csv"):
        label = name.replace("/data/", "/labels/").removesuffix(".csv") + ".txt"
        rows = parse_numbers(clone.read(name), columns=3, separator=",")
        if label not in clone.names or not len(rows):
            continue
        time_s, position, force_n = rows.T
        words = clone.read(label).decode("utf-8", "replace").split()
        rupture_n = float(words[-1])
        yield "mango", time_s - time_s[0], position / _COUNTS_PER_MM, force_n, rupture_n


def _load_array(clone: Clone, name: str) -> FloatArray:
    try:
        loaded = np.load(io.BytesIO(clone.read(name)), allow_pickle=False)
    except ValueError as error:
        raise InputError(
            f"{clone.path}: {name}: {error}; fetch its content with git lfs"
        ) from error
    return np.asarray(loaded, dtype=float)
