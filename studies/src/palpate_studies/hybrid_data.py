"""From recordings to what a hybrid grasp is made of: curves of fruit, laws and lags of sheets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.optimize import isotonic_regression

from palpate.arrays import FloatArray
from palpate.errors import InputError
from palpate.holds import Hold, read_holds
from palpate.tables import read_table
from palpate_studies.force_ladders import read_ladders
from palpate_studies.hybrid_world import Curve, Lag, RecordedSheet
from palpate_studies.ladder_models import Ladder

HORIZON_S = 20.0
#: Weight on the sheet of the holds in ohm, newtons (50 g): a hold doesn't give its own rest value.
HOLD_LOAD_N = 0.49
#: A curve needs this many rising samples below its rupture.
_FEWEST = 8


def read_curves(curves: Path, index: Path) -> list[Curve]:
    """Read closings as curves of force from (0, 0) to rupture.

    Most recordings begin under load already. What is missing before is drawn on as a line of the
    slope at their beginning.

    Raises
    ------
    InputError
        If a file can't be used, or a labelled closing has no curve.
    """
    labels = read_table(
        index, columns={"grasp_id": "text", "fruit": "text", "rupture_force_n": "number"}
    )
    samples = read_table(
        curves, columns={"grasp_id": "text", "closure_mm": "number", "force_n": "number"}
    )
    found = []
    for name, fruit, rupture_n in zip(*labels.values(), strict=True):
        mine = samples["grasp_id"] == name
        if not mine.any():
            raise InputError(f"{curves}: no curve for {name}, which {index} lists")
        closing, force = _rising(samples["closure_mm"][mine], samples["force_n"][mine], rupture_n)
        if closing.size >= _FEWEST:
            found.append(
                Curve(
                    name=str(name),
                    fruit=str(fruit),
                    closing_mm=closing,
                    force_n=force,
                    rupture_n=float(rupture_n),
                )
            )
    return found


def _rising(
    closure_mm: FloatArray, force_n: FloatArray, rupture_n: float
) -> tuple[FloatArray, FloatArray]:
    """Return the first crossings up to rupture, drawn on to no force."""
    end = int(np.argmax(force_n >= rupture_n)) + 1 if (force_n >= rupture_n).any() else len(force_n)
    closure, force = closure_mm[:end], force_n[:end]
    up = (force > np.maximum.accumulate(np.append(0.0, force[:-1]))) & (
        closure > np.maximum.accumulate(np.append(-np.inf, closure[:-1]))
    )
    closure, force = closure[up], force[up]
    if closure.size < _FEWEST:
        return closure, force
    early = force <= force[0] + 0.25 * (force[-1] - force[0])
    slope = (
        max(float(np.polyfit(closure[early], force[early], 1)[0]), 1e-3) if early.sum() > 2 else 1.0
    )
    before_mm = force[0] / slope
    closing, force = np.append(0.0, closure - closure[0] + before_mm), np.append(0.0, force)
    if force[-1] < rupture_n:
        # The sample at the label moved no further: the fingers stood, the force still rose.
        closing, force = np.append(closing, closing[-1] + 1e-3), np.append(force, rupture_n)
    return closing, force


def read_sheets(ladders: Path, holds: Sequence[Path]) -> list[RecordedSheet]:
    """Return a sheet for each ladder, which relaxes like the holds.

    Raises
    ------
    InputError
        If a file can't be used, or no hold lasts until the horizon.
    """
    long = [
        hold
        for path in holds
        for hold in read_holds(path, until_s=HORIZON_S + 1.0)
        if hold.time_s[-1] >= HORIZON_S and hold.time_s[0] < 1.0 and (hold.values > 0).all()
    ]
    if not long:
        raise InputError(f"{holds[0]}: no hold lasts {HORIZON_S:g} s; give longer ones")
    return [_sheet(ladder, long) for ladder in read_ladders(ladders)]


def _sheet(ladder: Ladder, holds: Sequence[Hold]) -> RecordedSheet:
    order = np.argsort(ladder.load_n, kind="stable")
    load_n = ladder.load_n[order]
    fall = np.log(ladder.rest_ohm / ladder.resistance_ohm[order])
    rising = np.asarray(isotonic_regression(fall).x)
    loads, first = np.unique(load_n, return_index=True)
    load, log_fall = np.append(0.0, loads), np.append(0.0, np.maximum(rising[first], 0.0))
    whole = float(np.interp(HOLD_LOAD_N, load, log_fall))
    return RecordedSheet(
        rest_ohm=ladder.rest_ohm,
        load_n=load,
        log_fall=log_fall,
        scatter=float(np.std(fall - rising, ddof=1)),
        lags=[_lag(hold, whole=whole) for hold in holds],
    )


def _lag(hold: Hold, *, whole: float) -> Lag:
    """Return how a hold settled, `whole` being its settled ln(rest / resistance)."""
    held = hold.time_s <= HORIZON_S
    settled = np.mean(hold.values[(hold.time_s > HORIZON_S - 0.5) & held])
    # A moving mean over a few samples: the hold's own noise would play along with each step again.
    smooth = np.convolve(hold.values[held], np.ones(3) / 3, mode="valid")
    return Lag(since_s=hold.time_s[held][1:-1], share=1.0 + np.log(settled / smooth) / whole)
