"""Real touches of a sheet with a load cell: where each begins, what is scored, what is measured."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.force_states import log_reading, states_of
from palpate.holds.strict import read_table

Mask: TypeAlias = NDArray[np.bool_]

#: Forces from here on are scored.
SMALLEST_N = 0.5
#: A touch whose highest conductance is less than this many times that at rest is off the sheet.
LEAST_RISE = 5.0
#: The rest reading is the median over this long, until this long before the touch; a touch is
#: followed from there.
_REST_S, _BEFORE_S = 1.0, 0.1
#: A touch begins where the reading, as `log_reading` gives it, is above this: a rise of 20 %. The
#: time since is counted in logarithms, from about a sample on.
_CONTACT, _TICK_S = float(log_reading(0.2)), 0.01
#: Shares of the touch's 80th percentile at which the force is measured once.
TOLD_SHARES = {"five_percent": 0.05, "eighty_percent": 0.8}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Touch:
    """One touch.

    Attributes
    ----------
    recording_id, sensor, pin, attempt : str
        As in the file; the parts of the name.
    touch : int
        Number of the place.
    time_s : ndarray, shape (n_times,)
        Since contact.
    inputs : ndarray, shape (n_times, n_inputs)
        See `force_states`; then the highest reading so far and the time since contact.
    log_force : ndarray, shape (n_times,)
        Of the load cell; forces below 0.1 N count as that.
    phase : ndarray of str, shape (n_times,)
        As in the file.
    scored : ndarray of bool, shape (n_times,)
        In contact, with 0.5 N and more.
    told : mapping of str to int
        Sample at which the force is measured once.
    """

    recording_id: str
    sensor: str
    pin: str
    attempt: str
    touch: int
    time_s: FloatArray
    inputs: FloatArray
    log_force: FloatArray
    phase: NDArray[np.str_]
    scored: Mask
    told: dict[str, int]

    @property
    def place(self) -> tuple[str, str, int]:
        """The key that the attempts share."""
        return (self.sensor, self.pin, self.touch)

    @property
    def weight(self) -> FloatArray:
        """How much each sample counts in a fit: unloading is short, and half of the task."""
        return np.where(self.phase == "unloading", 2.0, 1.0)

    def after(self, told: str) -> Mask:
        """Return the scored samples after the force was measured; all where it is not."""
        if told not in self.told:
            return self.scored
        return self.scored & (np.arange(len(self.scored)) > self.told[told])


def read_strokes(path: Path) -> list[Touch]:
    """Read recordings of touches and cut them.

    Raises
    ------
    InputError
        If the file can't be used or holds no touch of the sheet.
    """
    table = read_table(
        path,
        columns={
            "recording_id": "text",
            "time_s": "number",
            "resistance_ohm": "number",
            "force_n": "number",
            "touch": "number",
            "phase": "text",
        },
    )
    touches: list[Touch] = []
    for here in _cuts(table["recording_id"], table["touch"]):
        name = str(table["recording_id"][here.start])
        if name.count("-") < 2:
            raise InputError(f"{path}: recording {name!r} is not named sensor-pin-attempt")
        time_s, ohm = table["time_s"][here], table["resistance_ohm"][here]
        if (np.diff(time_s) <= 0).any() or (ohm <= 0).any():
            raise InputError(
                f"{path}: recording {name!r}: time_s must rise and resistance be above 0"
            )
        force_n, phase = table["force_n"][here], table["phase"][here]
        touches += _touch(name, int(table["touch"][here.start]), time_s, ohm, force_n, phase)
    if not touches:
        raise InputError(f"{path}: no touch in it raises the conductance {LEAST_RISE:g} times")
    return touches


def _cuts(recording: NDArray[np.str_], touch: FloatArray) -> Iterator[slice]:
    new = (recording[1:] != recording[:-1]) | (touch[1:] != touch[:-1])
    edges = [0, *(np.flatnonzero(new) + 1).tolist(), len(touch)]
    return (slice(a, b) for a, b in pairwise(edges))


def _touch(
    name: str,
    number: int,
    time_s: FloatArray,
    ohm: FloatArray,
    force_n: FloatArray,
    phase: NDArray[np.str_],
) -> list[Touch]:
    touched = np.flatnonzero(phase != "rest")
    if not len(touched):
        return []
    since_s = time_s - time_s[touched[0]]
    resting = (since_s < -_BEFORE_S) & (since_s > -_BEFORE_S - _REST_S)
    if not resting.any():
        return []
    rest_ohm = float(np.median(ohm[resting]))
    if rest_ohm / ohm[touched].min() < LEAST_RISE:
        return []
    used = since_s > -_BEFORE_S - _REST_S
    since_s, ohm, force_n, phase = since_s[used], ohm[used], force_n[used], phase[used]
    inside = np.flatnonzero(phase != "rest")
    high_n = float(np.percentile(force_n[inside], 80))
    sensor, pin, attempt = name.rsplit("-", 2)
    return [
        Touch(
            recording_id=name,
            sensor=sensor,
            pin=pin,
            attempt=attempt,
            touch=number,
            time_s=since_s,
            inputs=_inputs(since_s, log_reading(rest_ohm / ohm - 1)),
            log_force=np.log(np.maximum(force_n, 0.1)),
            phase=phase,
            scored=(phase != "rest") & (force_n >= SMALLEST_N),
            told={
                told: int(inside[np.flatnonzero(force_n[inside] >= share * high_n)[0]])
                for told, share in TOLD_SHARES.items()
            },
        )
    ]


def _inputs(time_s: FloatArray, reading: FloatArray) -> FloatArray:
    """Return the states, and what a touch as a whole shows: how high it rose, since when it lasts.

    Contact is where the reading shows it, not the load cell.
    """
    shown = np.flatnonzero(reading > _CONTACT)
    contact_s = time_s[shown[0]] if len(shown) else time_s[-1]
    lasting = np.log(np.maximum(time_s - contact_s, 0.0) + _TICK_S)
    states = states_of(time_s, reading)
    return np.column_stack([states, np.maximum.accumulate(reading), lasting])
