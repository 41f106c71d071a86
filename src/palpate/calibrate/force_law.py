"""Fit the force law of a calibration, and its errors on placements that the fit did not see."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from palpate.arrays import FloatArray
from palpate.calibration import Calibration
from palpate.force.line_law import fit_settled_line
from palpate.force.of_calibration import (
    DWELL_S,
    HORIZON_S,
    contacts_of,
    fit_sheet_law,
    fit_summed_law,
    is_made_by_weights,
    settled_pairs,
)
from palpate.force.sheet_law import SheetLaw
from palpate.force.weights_check import (
    FEWEST_PLACEMENTS,
    REPORTED_N,
    score_held_out_loads,
    score_line_held_out,
    score_loads,
    score_placements,
)


class Predictions(NamedTuple):
    """Readings of a calibration, each predicted by the law of the other placements; shape (n,)."""

    run: FloatArray
    value_n: FloatArray
    force_n: FloatArray
    since_move_s: FloatArray


def predict_held_out(recorded: Calibration) -> Predictions:
    """Predict the forces of each placement, or weight, with the law of all others.

    Raises `CalibrationError` as `SheetLaw.fit`.
    """
    pairs = recorded.force
    if is_made_by_weights(pairs):
        pairs = settled_pairs(pairs)
    contacts, run = contacts_of(pairs, layout=recorded.layout), np.array(pairs.run, dtype=float)
    order = np.argsort(run, kind="stable")
    others = SheetLaw.fit_others(contacts)
    # The first state is the rest before the placement.
    read = [law.read(states).force_n[1:] for law, (states, _) in zip(others, contacts, strict=True)]
    return Predictions(
        run=run[order],
        value_n=np.concatenate(read),
        force_n=np.concatenate([force_n[1:] for _, force_n in contacts]),
        since_move_s=np.array(pairs.since_move_s)[order],
    )


def add_line_law(recorded: Calibration) -> Calibration:
    """Return the calibration with the line of Table 4 and its held-out error.

    Raises `CalibrationError` if the pairs are insufficient for a line.
    """
    line = fit_settled_line(recorded.force, horizon_s=HORIZON_S)
    errors = score_line_held_out(recorded.force, horizon_s=HORIZON_S)
    held_out = {"of": "settled force by the line", "error_percent": errors}
    return replace(recorded, force_law=line.as_dict(), held_out=held_out)


def add_force_law(recorded: Calibration) -> Calibration:
    """Return the calibration with its force law and the expected error on a new placement.

    Raises
    ------
    CalibrationError
        If the force pairs are insufficient for a law.
    """
    pairs = recorded.force
    held_out: dict[str, Any] = {"of": "settled force"}
    if is_made_by_weights(pairs) and not pairs.pixel_excess:
        settled = settled_pairs(pairs)
        held_out["error_percent"] = score_held_out_loads(settled.excess, force_n=settled.force_n)
        return replace(recorded, force_law=fit_summed_law(pairs).as_dict(), held_out=held_out)
    law = fit_sheet_law(pairs, layout=recorded.layout)
    if is_made_by_weights(pairs):
        found = predict_held_out(recorded)
        held_out["error_percent"] = score_loads(found.value_n, force_n=found.force_n)
        return replace(recorded, force_law=law.as_dict(), held_out=held_out)
    for name, since_move_s in (("error_percent", HORIZON_S), ("early_error_percent", DWELL_S)):
        held_out[name] = _score_placements(recorded, since_move_s=since_move_s)
    return replace(recorded, force_law=law.as_dict(), held_out=held_out)


def _score_placements(recorded: Calibration, *, since_move_s: float) -> dict[str, float | None]:
    """Return the median errors on held-out placements near 1, 5 and 10 N, percent.

    `since_move_s`: age of the readings. None with too few placements, or if no reading is near.
    """
    if len(set(recorded.force.run)) < FEWEST_PLACEMENTS:
        return dict.fromkeys(REPORTED_N)
    found = predict_held_out(recorded)
    mine = np.isclose(found.since_move_s, since_move_s)
    return score_placements(found.value_n[mine], force_n=found.force_n[mine], run=found.run[mine])
