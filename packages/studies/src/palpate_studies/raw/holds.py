"""Convert holds of stretched silicone and foam tape, and strokes of a soft sensor."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate_studies.raw.clone import Clone, parse_numbers, write_table

SOFT_SENSOR = "data/loc_train.csv"
TAPE = "single-step-relaxation/original_data/"
#: A hold: largest displacement and shortest duration, after a motion of at least this size.
_STILL_MM, _HELD_S, _MOTION_MM = 0.02, 18.0, 0.1
#: Time 0 is the largest deviation within `_PEAK_S` from the value at `_SETTLED_S`, seconds.
_PEAK_S, _SETTLED_S = 2.0, 20.0
#: Holds of tape: duration, time step, and samples averaged for the peak.
_TAPE_S, _TAPE_STEP_S, _TAPE_MEAN = 60.0, 0.1, 5
_COLUMNS = ("hold_id", "time_s", "value")


def write_silicone(clone: Clone, out: Path) -> list[tuple[str, int]]:
    """Write holds of stretched silicone in ohm and newton; return files and row counts."""
    ohm: list[tuple[str, float, float]] = []
    force: list[tuple[str, float, float]] = []
    for name in (n for n in clone.names if n.endswith(".csv")):
        rows = parse_numbers(clone.read(name), columns=7, separator=",")
        if len(rows) < 2:
            continue
        outer_ohm, _, time_s, displacement_mm, _, force_n, force_time_s = rows.T
        stem = Path(name).stem
        for number, (start, end) in enumerate(_find_still(time_s, displacement_mm)):
            peak = _find_peak(time_s[start:end], outer_ohm[start:end])
            if peak is None:
                continue
            here = slice(start + peak, end)
            zero_s = time_s[here][0]
            hold = f"{stem}_h{number:02d}"
            ohm += _rows(hold, time_s[here] - zero_s, outer_ohm[here])
            later = force_time_s[here] - zero_s
            force += _rows(hold, np.maximum(later, 0.0), force_n[here])
    files = (("holds_cbsilicone.csv.gz", ohm), ("holds_force_relaxation.csv.gz", force))
    return [(name, write_table(out / name, _COLUMNS, rows)) for name, rows in files]


def _find_still(time_s: FloatArray, displacement_mm: FloatArray) -> Iterator[tuple[int, int]]:
    """Yield the first sample and the end of each hold after a motion."""
    start = 0
    for place in range(1, len(time_s) + 1):
        ended = place == len(time_s)
        if not ended and abs(displacement_mm[place] - displacement_mm[start]) <= _STILL_MM:
            continue
        moved = start > 0 and _find_travel_mm(time_s, displacement_mm, start) > _MOTION_MM
        if moved and time_s[place - 1] - time_s[start] >= _HELD_S:
            yield start, place
        start = place


def _find_travel_mm(time_s: FloatArray, displacement_mm: FloatArray, start: int) -> float:
    before = (time_s <= time_s[start]) & (time_s >= time_s[start] - _PEAK_S)
    return float(np.ptp(displacement_mm[before]))


def _find_peak(time_s: FloatArray, value: FloatArray) -> int | None:
    since_s = time_s - time_s[0]
    late = value[since_s >= min(_SETTLED_S, since_s[-1])]
    early = since_s <= _PEAK_S
    if not len(late) or not early.any():
        return None
    return int(np.argmax(np.abs(value[early] - late[0])))


def _rows(hold: str, time_s: FloatArray, value: FloatArray) -> list[tuple[str, float, float]]:
    rising = np.flatnonzero(np.diff(time_s, prepend=-np.inf) > 0)
    return [(hold, round(float(time_s[k]), 3), float(value[k])) for k in rising]


def write_tape(clone: Clone, out: Path) -> list[tuple[str, int]]:
    """Write the force of stretched foam tape; return the file and its row count."""
    rows: list[tuple[str, float, float]] = []
    for name in clone.under(TAPE, ending=".csv"):
        time_s, _, force_n = parse_numbers(clone.read(name), columns=3, separator=",").T
        if len(time_s) < _TAPE_MEAN:
            continue
        smooth = np.convolve(force_n, np.full(_TAPE_MEAN, 1.0 / _TAPE_MEAN), mode="same")
        since_s = time_s - time_s[int(np.argmax(smooth))]
        grid_s = np.arange(0.0, min(_TAPE_S, since_s[-1]) + 1e-9, _TAPE_STEP_S)
        rows += _rows(Path(name).stem, grid_s, np.interp(grid_s, since_s, force_n))
    return [("holds_tape.csv.gz", write_table(out / "holds_tape.csv.gz", _COLUMNS, rows))]


def write_soft_sensor(clone: Clone, out: Path) -> list[tuple[str, int]]:
    """Write `soft_sensor_ral2018.csv.gz`; return the file and its row count."""
    table = parse_numbers(clone.read(SOFT_SENSOR), columns=7, separator=",")
    rows = [
        (int(trial), sample, x_mm, abs(z_mm), speed, voltage_v, -force_n)
        for stroke in np.split(table, np.flatnonzero(np.diff(table[:, 0])) + 1)
        for sample, (trial, x_mm, z_mm, speed, voltage_v, _, force_n) in enumerate(stroke.tolist())
    ]
    labels = ("stroke_id", "sample", "location_mm", "depth_mm", "speed_mm_s")
    name = "soft_sensor_ral2018.csv.gz"
    return [(name, write_table(out / name, (*labels, "voltage_v", "force_n"), rows))]
