"""Convert strokes and ladders from github.com/Lupasic/tactile-sensor-velostat."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate_studies.raw.clone import Clone, parse_numbers, write_table

STROKES = "src/experimental_data/question_4/"
LADDERS = "src/experimental_data/archive/velostat_data_for_calibration_"
#: Delay of the logger's timestamp of the resistance: half a sample, seconds.
_LATE_S = 0.004
#: Unloaded forces differ by less than this from the median of the first samples, newtons.
_UNLOADED_N, _FIRST = 0.5, 200
#: Upper limit of the duration of a recording, seconds.
_LONGEST_S = 1e5
#: Force threshold of a touch, fraction of its maximum at which it is held, and samples of the
#: running mean.
_TOUCH_N, _HELD, _MEAN = 0.25, 0.8, 5
#: Dead weights: time after which readings are settled, seconds; newtons per kilogram.
_SETTLED_S, _N_PER_KG = 5.0, 9.80665


def write_strokes(clone: Clone, out: Path) -> list[tuple[str, int]]:
    """Write `velostat_strokes.csv.gz`; return the file and its row count."""
    folders = sorted({name.rsplit("/", 1)[0] for name in clone.under(STROKES, ending=".txt")})
    rows = [row for folder in folders for row in _read_recording(clone, folder)]
    columns = ("recording_id", "time_s", "resistance_ohm", "force_n", "touch", "phase")
    name = "velostat_strokes.csv.gz"
    return [(name, write_table(out / name, columns, rows))]


def _read_recording(
    clone: Clone, folder: str
) -> Iterator[tuple[str, float, float, float, int, str]]:
    sensor, pin, attempt = folder.removeprefix(STROKES).split("/")
    pin_mm, number = pin.split("_")[0], attempt.rsplit("_", 1)[-1]
    ending = f"{pin_mm}_p_{number}.txt"
    named = {part: f"{folder}/exp_{part}{ending}" for part in ("", "futek_extra_", "futek_")}
    if not set(named.values()) <= set(clone.names):
        return
    ohm, force = (_sort_rows(clone.read(named[part])) for part in ("", "futek_extra_"))
    labels = sorted(
        float(line.split()[1])
        for line in clone.read(named["futek_"]).decode("utf-8", "replace").splitlines()
        if line.split()[2:] == ["touch_grd"]
    )
    if not (len(ohm) and len(force) and labels):
        return
    first = np.median(force[:_FIRST, 0])
    unloaded = np.median(force[np.abs(force[:, 0] - first) <= _UNLOADED_N, 0])
    ohm = ohm[ohm[:, 0] > 0]
    time_s = ohm[:, 1] - _LATE_S
    force_n = np.interp(time_s, force[:, 1], force[:, 0]) - unloaded
    starts = np.unique(labels)
    touch = np.searchsorted((starts[1:] + starts[:-1]) / 2, time_s)
    phase = np.concatenate([_label_phases(force_n[touch == one]) for one in range(len(starts))])
    name = f"{sensor}-{pin_mm}mm-a{number}"
    for place in range(len(time_s)):
        yield (
            name,
            round(float(time_s[place] - time_s[0]), 4),
            float(ohm[place, 0]),
            round(float(force_n[place]), 3),
            int(touch[place]),
            str(phase[place]),
        )


def _sort_rows(text: bytes) -> FloatArray:
    rows = parse_numbers(text, columns=2)
    if not len(rows):
        return rows
    # A truncated line may contain two numbers, but an invalid time.
    rows = rows[np.abs(rows[:, 1] - np.median(rows[:, 1])) < _LONGEST_S]
    rows = rows[np.argsort(rows[:, 1], kind="stable")]
    # Times repeat at broken lines.
    return rows[np.diff(rows[:, 1], prepend=-np.inf) > 0]


def _label_phases(force_n: FloatArray) -> NDArray[np.str_]:
    """Label the samples of one touch as rest, loading, holding or unloading."""
    found = np.full(len(force_n), "rest", dtype="<U9")
    if len(force_n) < _MEAN:
        return found
    smooth = np.convolve(force_n, np.full(_MEAN, 1.0 / _MEAN), mode="same")
    top = int(np.argmax(smooth))
    if smooth[top] <= _TOUCH_N:
        return found
    below = smooth <= _TOUCH_N
    begin = int(np.flatnonzero(np.r_[True, below[:top]])[-1])
    after = np.flatnonzero(below[top:])
    end = top + int(after[0]) if len(after) else len(force_n)
    held = begin + np.flatnonzero(smooth[begin:end] >= _HELD * smooth[top])
    found[begin : held[0]] = "loading"
    found[held[0] : held[-1] + 1] = "holding"
    found[held[-1] + 1 : end] = "unloading"
    return found


def write_ladders(clone: Clone, out: Path) -> list[tuple[str, int]]:
    """Write `velostat_force_ladders.csv`; return the file and its row count."""
    rows = []
    names = clone.under(LADDERS, ending=".txt")
    for folder, each in groupby(names, key=lambda name: name.rsplit("/", 1)[0]):
        steps = sorted(each, key=lambda name: int(name.rsplit("_", 1)[-1].removesuffix(".txt")))
        for name in steps:
            ohm, time_s, load_kg = parse_numbers(clone.read(name), columns=3).T
            if not len(ohm):
                continue
            late = ohm[time_s >= time_s.min() + _SETTLED_S]
            settled = late if len(late) else ohm
            rows.append(
                (
                    folder.removeprefix(LADDERS),
                    int(name.rsplit("_", 1)[-1].removesuffix(".txt")),
                    round(float(np.median(load_kg)) * _N_PER_KG, 4),
                    float(np.median(settled)),
                    float(np.subtract(*np.percentile(settled, [75, 25]))),
                )
            )
    columns = ("ladder", "step", "load_n", "resistance_ohm", "spread_ohm")
    name = "velostat_force_ladders.csv"
    return [(name, write_table(out / name, columns, rows))]
