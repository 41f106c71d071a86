"""Whether the stress relaxation of a conductive rubber can be followed from its resistance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.estimate.creep import CONTACT_EXCESS
from palpate.estimate.observer_fit import Trace, fit_observer
from palpate.holds import read_holds
from palpate_studies.press_data import Press
from palpate_studies.press_follow import Followed, follow
from palpate_studies.report import Table
from palpate_studies.specimens import specimen_of
from palpate_studies.stretch_bounds import BOUNDS, bound_errors

#: The force is told once, this long after the peak; before it the fixture still rings.
TOLD_S = 0.5
#: Model -> whether it remembers, and whether it knows that the clip stands still.
MODELS: Mapping[str, tuple[bool, bool]] = {
    "static": (False, False),
    "observer, sheet alone": (True, False),
    "observer": (True, True),
}
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
        told = int(np.searchsorted(time_s, TOLD_S))
        if told >= len(time_s) - 1:
            continue
        ohm = np.interp(time_s, hold.time_s, hold.values)
        trace = Trace(
            time_s=time_s,
            # Under stretch resistance and force fall together: resistance takes the place of
            # conductance, and the offset cancels the one that the creep states add.
            excess=ohm / ohm[0] - CONTACT_EXCESS,
            resolution=np.zeros_like(ohm),
            force_n=cell.values[kept],
            first=told,
            told=told,
            group=specimen_of(hold.hold_id),
            # The clip stands still from the peak on: one step, of a size that doesn't matter.
            deformation=np.ones_like(time_s),
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


def follow_stretches(
    stretches: Sequence[Press], *, level: float
) -> Mapping[str, Sequence[Followed]]:
    """Follow each specimen with models learned from the others; return them by model."""
    followed: dict[str, list[Followed]] = {name: [] for name in MODELS}
    for specimen in dict.fromkeys(one.trace.group for one in stretches):
        for name, (memory, closure) in MODELS.items():
            seen = [one if closure else _sheet_alone(one) for one in stretches]
            model = fit_observer(
                [one.trace for one in seen if one.trace.group != specimen], memory=memory
            )
            followed[name] += [
                follow(one, model, level=level) for one in seen if one.trace.group == specimen
            ]
    return followed


def _sheet_alone(stretch: Press) -> Press:
    return replace(stretch, trace=replace(stretch.trace, deformation=None))


def stretch_table(
    stretches: Sequence[Press], followed: Mapping[str, Sequence[Followed]]
) -> tuple[Table, list[dict[str, Any]]]:
    """Return the table of every model and bound, by specimen, and its rows."""
    specimens = ["all", *dict.fromkeys(one.trace.group for one in stretches)]
    rows = [
        _score(name, specimen, each) for specimen in specimens for name, each in followed.items()
    ]
    for name, reads in BOUNDS.items():
        bounds = list(bound_errors(stretches, reads=reads))
        rows += [_bound_score(name, specimen, bounds) for specimen in specimens]
    rows.sort(key=lambda row: specimens.index(row["specimen"]))
    columns = {
        "median_abs_log_error": "median abs ln error",
        "final_log_error": "at 20 s",
        "coverage": "coverage",
        "told_force_held_log_error": "told force held",
    }
    table = Table(
        title="Relaxation of stretched silicone from its resistance, specimens held out",
        columns=("specimen", "model", "holds", *columns.values()),
        rows=[
            [row["specimen"], row["model"], str(row["holds"])]
            + ["-" if row[key] is None else f"{row[key]:.4f}" for key in columns]
            for row in rows
        ],
    )
    return table, rows


def _bound_score(
    model: str, specimen: str, bounds: Sequence[tuple[Press, FloatArray]]
) -> dict[str, Any]:
    mine = [error for one, error in bounds if specimen in ("all", one.trace.group)]
    return {
        "specimen": specimen,
        "model": model,
        "holds": len(mine),
        "median_abs_log_error": float(np.median([np.median(np.abs(error)) for error in mine])),
        "final_log_error": float(np.median([abs(error[-1]) for error in mine])),
        "coverage": None,
        "told_force_held_log_error": None,
    }


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
