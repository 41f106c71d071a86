"""Read real presses of a sheet with a load cell, and cut recordings into presses."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate_studies.recordings import read_runs

#: Thresholds of a press: smallest force, and fraction of the recording's 90th percentile.
SMALLEST_FORCE_N = 0.5
FRACTION_OF_P90 = 0.3
#: Shortest duration of a press.
SHORTEST_S = 0.8
#: The force is given once, when it first reaches this fraction of the press's 80th percentile.
GIVEN_FRACTION = 0.8
#: A trace starts this long before the press, but not before the end of the previous press.
LEAD_S = 3.0
#: The rest reading is the median over `REST_S`, ending `BEFORE_S` before the press.
REST_S, BEFORE_S = 1.0, 0.3


@dataclass(frozen=True, slots=True, kw_only=True)
class Trace:
    """One loading of one sheet with its reference force.

    Attributes
    ----------
    time_s, excess, force_n : ndarray, shape (n_times,)
        Samples from before the contact; `excess` is the conductance G/G0 - 1.
    first, given : int
        First sample above the force threshold, and sample at which the force is given.
    group : str
        Traces of one group (a sensor, a setting) are held out together.
    """

    time_s: FloatArray
    excess: FloatArray
    force_n: FloatArray
    first: int
    given: int
    group: str


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Press:
    """One press.

    Attributes
    ----------
    recording_id : str
        Identifier in the file.
    press : int
        Number in its recording, from 0.
    trace : Trace
        Readings and force. The group is the setting, which is shared by its repeats.
    last_held : int
        Last sample at or above the given force; the release follows.
    """

    recording_id: str
    press: int
    trace: Trace
    last_held: int


def read_presses(path: Path) -> list[Press]:
    """Read recordings `recording_id,time_s,resistance_ohm,force_n` and cut them into presses.

    Raises
    ------
    InputError
        If the file can't be used, a time does not increase, or no press is found.
    """
    presses: list[Press] = []
    numbers = ("time_s", "resistance_ohm", "force_n")
    for run in read_runs(path, keys=("recording_id",), text=("recording_id",), numbers=numbers):
        name, (time_s, ohm, force_n) = str(run["recording_id"][0]), (run[key] for key in numbers)
        where = f"{path}: recording {name!r}"
        if (np.diff(time_s) <= 0).any():
            raise InputError(f"{where}: time_s doesn't increase; sort it by time")
        if (ohm <= 0).any():
            raise InputError(f"{where} has a resistance of 0 ohm or less; remove those samples")
        presses += cut_presses(name, time_s, ohm, force_n)
    if not presses:
        raise InputError(
            f"{path}: no press found (force above {SMALLEST_FORCE_N} N for {SHORTEST_S} s)"
        )
    return presses


def setting_of(recording_id: str) -> str:
    """Return the setting of a recording: its name without the repeat's number.

    Examples
    --------
    >>> setting_of("pike3_sensor1_exp2_5c15")
    'pike3_sensor1'
    """
    return re.sub(r"_exp\d+(_[0-9a-f]+)?$", "", recording_id)


def cut_presses(
    recording_id: str, time_s: FloatArray, ohm: FloatArray, force_n: FloatArray
) -> list[Press]:
    """Cut one recording into its presses; each array has shape (n_times,)."""
    presses: list[Press] = []
    previous_end = 0
    for begin, end in _find_presses(time_s, force_n):
        held_n = GIVEN_FRACTION * np.percentile(force_n[begin:end], 80)
        enough = np.flatnonzero(force_n[begin:end] >= held_n) + begin
        lead = max(int(np.searchsorted(time_s, time_s[begin] - LEAD_S)), previous_end)
        here = slice(lead, end)
        excess = _rest_ohm(time_s, ohm, begin=begin, since=previous_end) / ohm[here] - 1
        trace = Trace(
            time_s=time_s[here],
            excess=excess,
            force_n=force_n[here],
            first=begin - lead,
            given=int(enough[0]) - lead,
            group=setting_of(recording_id),
        )
        if trace.given < len(trace.time_s) - 1:
            presses.append(
                Press(
                    recording_id=recording_id,
                    press=len(presses),
                    trace=trace,
                    last_held=int(enough[-1]) - lead,
                )
            )
        previous_end = end
    return presses


def _find_presses(time_s: FloatArray, force_n: FloatArray) -> Sequence[tuple[int, int]]:
    """Return the start and the end of each press, as half-open sample ranges."""
    above = force_n > max(SMALLEST_FORCE_N, FRACTION_OF_P90 * float(np.percentile(force_n, 90)))
    edges = np.flatnonzero(np.diff(np.r_[False, above, False].astype(int)))
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [(a, b) for a, b in runs if time_s[b - 1] - time_s[a] >= SHORTEST_S]


def _rest_ohm(time_s: FloatArray, ohm: FloatArray, *, begin: int, since: int) -> float:
    """Return the rest reading before a press, from earlier resistances alone."""
    until = int(np.searchsorted(time_s, time_s[begin] - BEFORE_S))
    start = max(int(np.searchsorted(time_s, time_s[begin] - BEFORE_S - REST_S)), since)
    if until - start >= 5:
        return float(np.median(ohm[start:until]))
    # Without recorded rest, the largest resistance so far is the least loaded reading.
    return float(np.max(ohm[: begin + 1]))
