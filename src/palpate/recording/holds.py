"""Cutting holds out of a recording: the stretches in which a closed gripper stood still."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import CalibrationError, RecordingError
from palpate.holds import Hold
from palpate.recording.contents import GripperTrack, Recording
from palpate.sensor.pixel_resistance import pixel_resistance_ohm
from palpate.signal.events import actuation_spikes
from palpate.signal.relative import (
    CONTACT_PERCENT,
    largest_change,
    mean_change,
    relative_change_percent,
    rest_baseline,
)

Unit = Literal["percent", "ohm"]
#: Shorter stretches are steps of a closing staircase, not holds.
SHORTEST_HOLD_S = 1.0
#: How much of the recording's beginning is taken as rest where the gripper moves at once.
REST_S = 1.0
_FEWEST_FRAMES = 10
#: Change of position that is movement: more than an encoder step, or a regulator's noise.
_MOVED_MM, _MOVED_KPA = 0.08, 0.6


def recorded_resistance_ohm(recording: Recording) -> FloatArray:
    """Return the pixels' resistances, shape (n_frames, rows, cols); crosstalk is solved out."""
    ohm = np.empty(recording.counts.shape)
    for oversampling in np.unique(recording.oversampling):
        frames = recording.oversampling == oversampling
        ohm[frames] = pixel_resistance_ohm(
            recording.counts[frames],
            layout=recording.info.layout,
            oversampling=int(oversampling),
        )
    return ohm


def cut_holds(recording: Recording, *, unit: Unit = "percent", name: str = "hold") -> list[Hold]:
    """Cut out every hold of at least a second in which something was touched.

    A hold begins when the gripper's movement ends (time 0) and lasts until it moves again. Where
    no movement was recorded, it begins at an actuation spike and lasts until the next one.

    Parameters
    ----------
    recording : Recording
        With about a second of rest before the first contact.
    unit : {"percent", "ohm"}
        Relative change against the rest at the beginning, or resistance.
    name : str
        Beginning of the holds' names.

    Returns
    -------
    list of Hold
        For each hold the channel ``mean`` (percent only: the paper's aggregate) and one per pixel,
        ``r0c0`` and so on; open pixels are left out.

    Raises
    ------
    RecordingError
        If there is no rest to compare with, or no hold.
    """
    if len(recording.time_s) < _FEWEST_FRAMES:
        raise RecordingError(f"only {len(recording.time_s)} frames: too few to cut holds from")
    ohm = recorded_resistance_ohm(recording)
    change = relative_change_percent(ohm, rest_ohm=_rest_ohm(recording, ohm))
    values = change if unit == "percent" else ohm
    holds: list[Hold] = []
    for number, (start_s, end_s) in enumerate(_still_stretches(recording, change), start=1):
        frames = _strictly_increasing(recording.time_s, start_s, end_s)
        touched = len(frames) >= _FEWEST_FRAMES and (
            np.median(largest_change(change[frames[len(frames) // 2 :]])) <= CONTACT_PERCENT
        )
        if touched:
            time_s = recording.time_s[frames] - start_s
            holds += _channels(f"{name}-{number}", time_s, values[frames], unit=unit)
    if not holds:
        raise RecordingError(
            f"no hold found: nothing was touched for {SHORTEST_HOLD_S:g} s after a movement"
        )
    return holds


def _rest_ohm(recording: Recording, ohm: FloatArray) -> FloatArray:
    """Return the rest before the first movement, or of the first second."""
    moved = _moved(recording.gripper)
    first = int(np.argmax(moved)) if moved.any() else 0
    rest_end_s = recording.gripper.time_s[first - 1] if first else recording.time_s[0] + REST_S
    try:
        return rest_baseline(ohm[recording.time_s <= rest_end_s]).rest_ohm
    except CalibrationError as error:
        raise RecordingError(
            f"no rest at the beginning to compare with: {error}. Record a second of rest first"
        ) from error


def _still_stretches(recording: Recording, change: FloatArray) -> list[tuple[float, float]]:
    """Return start and end of every stretch without movement that follows a movement."""
    end_s = float(recording.time_s[-1])
    moved, at_s = _moved(recording.gripper), recording.gripper.time_s
    if moved.any():
        turns = np.flatnonzero(np.diff(moved.astype(np.int8)))
        stops = [float(at_s[k + recording.gripper.moving[k]]) for k in turns if moved[k]]
        # A frame after the last still state may have been scanned in motion.
        starts = [float(at_s[k]) for k in turns if not moved[k]]
    else:
        stops = starts = [
            spike.time_s for spike in actuation_spikes(recording.time_s, mean_change(change))
        ]
    ends = [min((s for s in starts if s > stop), default=end_s) for stop in stops]
    return [
        (stop, end) for stop, end in zip(stops, ends, strict=True) if end - stop >= SHORTEST_HOLD_S
    ]


def _moved(gripper: GripperTrack) -> NDArray[np.bool_]:
    """Return at which states the gripper moves, or has moved since the state before.

    At 15 frames/s a short step lies wholly between two states.
    """
    moved = gripper.moving.copy()
    for position, step in ((gripper.width_mm, _MOVED_MM), (gripper.pressure_kpa, _MOVED_KPA)):
        # A comparison with NaN, a position not sensed, is False.
        moved[1:] |= np.abs(np.diff(position)) > step
    return moved


def _strictly_increasing(time_s: FloatArray, start_s: float, end_s: float) -> NDArray[np.intp]:
    """Return the frames from `start_s` to before `end_s`, without repeated times."""
    inside = np.flatnonzero((time_s >= start_s) & (time_s < end_s))
    keep = np.ones(len(inside), dtype=bool)
    keep[1:] = np.diff(np.maximum.accumulate(time_s[inside])) > 0
    return inside[keep]


def _channels(hold_id: str, time_s: FloatArray, values: FloatArray, *, unit: Unit) -> list[Hold]:
    columns = {
        f"r{row}c{col}": values[:, row, col]
        for row in range(values.shape[1])
        for col in range(values.shape[2])
    }
    if unit == "percent":
        columns = {"mean": mean_change(values), **columns}
    return [
        Hold(hold_id=hold_id, channel=channel, time_s=time_s, values=column, unit=unit)
        for channel, column in columns.items()
        if np.isfinite(column).all()
    ]
