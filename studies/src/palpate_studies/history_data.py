"""Recordings of a stretched conductive rubber with its force, and what the models see of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.force_states import states_of
from palpate.holds.strict import read_table

#: From a few readings at 12 Hz to a slow cycle; longer ones learn the drift of single recordings.
_TIME_CONSTANTS_S = (0.3, 1.0, 3.0, 10.0, 30.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class History:
    """One recording.

    Attributes
    ----------
    recording_id : str
        As in the file.
    time_s, log_ohm, force_n : ndarray, shape (n_times,)
        Logarithm of the four-wire resistance, of two neighbours: the current is reversed from one
        sample to the next.
    """

    recording_id: str
    time_s: FloatArray
    log_ohm: FloatArray
    force_n: FloatArray

    @property
    def kind(self) -> str:
        """Kind of motion: the name up to its first hyphen."""
        return self.recording_id.split("-")[0]

    @cached_property
    def inputs(self) -> FloatArray:
        """What the models see, shape (n_times, n_inputs)."""
        return states_of(self.time_s, self.log_ohm, time_constants_s=_TIME_CONSTANTS_S)


def read_histories(path: Path) -> list[History]:
    """Read `recording_id,time_s,resistance_4wire_ohm,force_n`.

    Raises
    ------
    InputError
        If the file can't be used, time runs backwards, or a resistance is not above 0.
    """
    table = read_table(
        path,
        columns={
            "recording_id": "text",
            "time_s": "number",
            "resistance_4wire_ohm": "number",
            "force_n": "number",
        },
    )
    found = []
    for name in dict.fromkeys(table["recording_id"].tolist()):
        here = table["recording_id"] == name
        time_s, ohm = table["time_s"][here], table["resistance_4wire_ohm"][here]
        if len(time_s) < 2 or (np.diff(time_s) < 0).any() or not (ohm > 0).all():
            raise InputError(
                f"{path}: recording {name!r}: time_s must not fall and resistance be above 0"
            )
        pairs = (ohm + np.r_[ohm[:1], ohm[:-1]]) / 2
        found.append(
            History(
                recording_id=str(name),
                time_s=time_s,
                log_ohm=np.log(pairs),
                force_n=table["force_n"][here],
            )
        )
    if not found:
        raise InputError(f"{path}: no recording in it")
    return found
