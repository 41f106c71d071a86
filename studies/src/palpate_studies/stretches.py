"""Whether the stress relaxation of a conductive rubber can be followed from its resistance."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.force_states import CONTACT_EXCESS, log_reading, states_of
from palpate.holds import read_holds
from palpate_studies.force_model import ForceModel
from palpate_studies.press_data import Press, Trace
from palpate_studies.press_follow import Followed, in_newtons
from palpate_studies.press_models import LEVEL, Follower, Presses, log_change
from palpate_studies.report import Table
from palpate_studies.specimens import specimen_of

#: The force is given once, this long after the peak; before it the fixture still rings.
TOLD_S = 0.5
#: Of the history of the resistance: from a few readings to half of a hold.
_TIME_CONSTANTS_S = (0.3, 1.0, 3.0, 10.0)
#: Followed until here, the horizon of a settled value.
HORIZON_S = 20.0


def read_stretches(resistance: Path, *, force: Path) -> list[Press]:
    """Read the resistance and the force of the same stretches, matched by hold id.

    Raises
    ------
    InputError
        If a file can't be used, or they have fewer than two specimens in common.
    """
    forces = {hold.hold_id: hold for hold in read_holds(force)}
    stretches = []
    for hold in read_holds(resistance):
        cell = forces.get(hold.hold_id)
        if cell is None or (cell.values <= 0).any() or (hold.values <= 0).any():
            continue
        end_s = min(HORIZON_S, hold.time_s[-1], cell.time_s[-1])
        kept = cell.time_s <= end_s
        time_s = cell.time_s[kept]
        given = int(np.searchsorted(time_s, TOLD_S))
        if given >= len(time_s) - 1:
            continue
        ohm = np.interp(time_s, hold.time_s, hold.values)
        trace = Trace(
            time_s=time_s,
            # Under stretch resistance and force fall together: resistance takes the place of
            # conductance, and the offset cancels the one that the creep states add.
            excess=ohm / ohm[0] - CONTACT_EXCESS,
            force_n=cell.values[kept],
            first=given,
            told=given,
            group=specimen_of(hold.hold_id),
        )
        stretches.append(
            Press(recording_id=hold.hold_id, press=0, trace=trace, last_held=len(time_s) - 1)
        )
    if len({stretch.trace.group for stretch in stretches}) < 2:
        raise InputError(
            f"{resistance} and {force}: fewer than two specimens in common; "
            "give the two channels of the same holds"
        )
    return stretches


def follow_stretches(stretches: Presses) -> Mapping[str, Sequence[Followed]]:
    """Follow each specimen with models learned from the others; return them by model."""
    followed: dict[str, list[Followed]] = {name: [] for name in MODELS}
    for specimen in dict.fromkeys(one.trace.group for one in stretches):
        others = [one for one in stretches if one.trace.group != specimen]
        for name, learn in MODELS.items():
            follow = learn(others)
            followed[name] += [
                in_newtons(one, follow(one)) for one in stretches if one.trace.group == specimen
            ]
    return followed


def static(train: Presses) -> Follower:
    """Learn a power law of the change of the resistance."""
    return _learned(train, lambda one: _history(one)[:, :1], landmarks=0)


def observer(train: Presses) -> Follower:
    """Learn the force model on the history of the resistance and the measured force."""
    return _learned(train, _history)


def clock(train: Presses) -> Follower:
    """Learn the usual relaxation at each time, by a share that depends on the measured force."""
    return _learned(train, _clock, landmarks=0)


def _learned(
    train: Presses, inputs: Callable[[Press], FloatArray], *, landmarks: int = 120
) -> Follower:
    parts = [inputs(one)[one.trace.told + 1 :] for one in train]
    targets = [log_change(one)[one.trace.told + 1 :] for one in train]
    model = ForceModel.fit(
        np.concatenate(parts),
        target=np.concatenate(targets),
        group=[one.trace.group for one, part in zip(train, parts, strict=True) for _ in part],
        # Each hold counts the same, however often it was read.
        weight=np.concatenate([np.full(len(part), 100.0 / len(part)) for part in parts]),
        landmarks=landmarks,
    )
    return lambda one: model.predict(inputs(one), level=LEVEL)


def _history(stretch: Press) -> FloatArray:
    trace = stretch.trace
    reading = log_reading(trace.excess)
    states = states_of(trace.time_s, reading, time_constants_s=_TIME_CONSTANTS_S)
    return np.concatenate([states - states[trace.told], _log_given(stretch)], axis=1)


def _clock(stretch: Press) -> FloatArray:
    trace = stretch.trace
    since_s = np.maximum(trace.time_s - trace.time_s[trace.told], 0.0)
    ticks = np.log1p(since_s / TOLD_S)[:, None]
    return np.concatenate([ticks, ticks * _log_given(stretch)], axis=1)


def _log_given(stretch: Press) -> FloatArray:
    trace = stretch.trace
    return np.full((len(trace.time_s), 1), np.log(trace.force_n[trace.told]))


#: Name -> how it is learned.
MODELS: Mapping[str, Callable[[Presses], Follower]] = {
    "static": static,
    "observer": observer,
    "clock, no sensor": clock,
}


def stretch_table(
    stretches: Sequence[Press], followed: Mapping[str, Sequence[Followed]]
) -> tuple[Table, list[dict[str, Any]]]:
    """Return the table of every model and bound, by specimen, and its rows."""
    specimens = ["all", *dict.fromkeys(one.trace.group for one in stretches)]
    rows = [
        _score(name, specimen, each) for specimen in specimens for name, each in followed.items()
    ]
    rows.sort(key=lambda row: specimens.index(row["specimen"]))
    columns = {
        "median_abs_log_error": "median abs ln error",
        "final_log_error": "at 20 s",
        "coverage": "coverage",
        "told_force_held_log_error": "given force held",
    }
    table = Table(
        title="Relaxation of stretched silicone from its resistance, specimens held out",
        columns=("specimen", "model", "holds", *columns.values()),
        rows=[
            [row["specimen"], row["model"], str(row["holds"])]
            + [f"{row[key]:.4f}" for key in columns]
            for row in rows
        ],
    )
    return table, rows


def _score(model: str, specimen: str, followed: Sequence[Followed]) -> dict[str, Any]:
    mine = [one for one in followed if specimen in ("all", one.press.trace.group)]
    still = [np.median(np.abs(np.log(one.truth_n / one.told_n))) for one in mine]
    return {
        "specimen": specimen,
        "model": model,
        "holds": len(mine),
        "median_abs_log_error": float(np.median([np.median(np.abs(x.log_error)) for x in mine])),
        "final_log_error": float(np.median([abs(x.log_error[-1]) for x in mine])),
        "coverage": float(np.mean([np.mean(x.covered) for x in mine])),
        "told_force_held_log_error": float(np.median(still)),
    }
