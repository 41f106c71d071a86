"""Every method on the holds of one file; ours also calibrated, on other specimens alone."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from palpate.holds import Hold
from palpate.settling.evaluate import Prediction, predict_holds
from palpate.settling.predict import METHODS, method_named
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod
from palpate.settling.scoring import median
from palpate_studies.specimens import (
    FEWEST_SPECIMENS,
    HORIZON_S,
    predict_held_out,
    settled_holds,
    specimen_of,
)

CUTOFFS_S = (1.0, 2.0, 2.5, 3.0, 5.0, 8.0, 10.0, 15.0)
LEVEL = 0.9

#: The paper's choice of cut-off: the tables of specimens and of the worst holds are made there.
MAIN_CUTOFF_S = 2.5
OURS, CALIBRATED, BEST = "relaxation", "calibrated", "best simple"


@dataclass(frozen=True, slots=True, kw_only=True)
class FileResult:
    """Everything computed on one holds file.

    Attributes
    ----------
    name : str
        Of the file.
    holds : sequence of Hold
        Those that reach the horizon.
    specimens : mapping of str to str
        Hold and channel -> specimen.
    unit : str
        What was left out for calibration and drawn by the bootstrap: ``specimen`` or ``hold``.
    predictions : sequence of Prediction
        Of every method and cut-off.
    """

    name: str
    holds: Sequence[Hold]
    specimens: Mapping[str, str]
    unit: str
    predictions: Sequence[Prediction]

    def of(self, method: str, cutoff_s: float) -> list[Prediction]:
        """Return the predictions of one method at one cut-off."""
        return [p for p in self.predictions if (p.method, p.cutoff_s) == (method, cutoff_s)]

    def unit_of(self, prediction: Prediction) -> str:
        """Return what a prediction's hold is drawn with by the bootstrap."""
        return self.specimens[prediction.hold_id] if self.unit == "specimen" else prediction.hold_id


def baselines() -> dict[str, SettlingMethod]:
    """Return what ours has to beat: waiting, the paper's exponential and two plain log laws."""
    return {name: method_named(name) for name in METHODS if name != OURS}


def analyse(file: Path, *, pattern: re.Pattern[str] | None = None) -> FileResult:
    """Predict every hold of a file with every method, ours also calibrated on other specimens.

    The best simple rule is chosen on other specimens, too, at each cut-off.

    Raises
    ------
    InputError
        If no hold of the file reaches the horizon.
    """
    holds = settled_holds(file)
    specimens = {hold.hold_id: specimen_of(hold.hold_id, pattern=pattern) for hold in holds}
    enough = len(set(specimens.values())) >= FEWEST_SPECIMENS
    unit_of = {name: specimens[name] if enough else name for name in specimens}
    grid: dict[str, Any] = {"cutoffs_s": CUTOFFS_S, "horizon_s": HORIZON_S, "level": LEVEL}
    simple = list(predict_holds(holds, methods=baselines(), **grid))
    ours = predict_holds(holds, methods={OURS: Relaxation()}, **grid)
    calibrated = predict_held_out(
        holds,
        units=[unit_of[hold.hold_id] for hold in holds],
        calibrate=lambda others: Relaxation().calibrated_on(others, horizon_s=HORIZON_S),
        name=CALIBRATED,
        **grid,
    )
    return FileResult(
        name=file.name,
        holds=holds,
        specimens=specimens,
        unit="specimen" if enough else "hold",
        predictions=[*simple, *_best_simple(simple, unit_of), *ours, *calibrated],
    )


def _best_simple(simple: Sequence[Prediction], unit_of: Mapping[str, str]) -> Iterator[Prediction]:
    """Yield for each unit the answer of the rule whose median |error| is smallest on all others."""
    units = sorted(set(unit_of.values()))
    for cutoff_s in CUTOFFS_S:
        rows = [row for row in simple if row.cutoff_s == cutoff_s]
        for left_out in units if len(units) > 1 else ():
            errors: dict[str, list[float]] = {}
            for row in rows:
                if unit_of[row.hold_id] != left_out:
                    errors.setdefault(row.method, []).append(abs(row.predicted / row.settled - 1))
            chosen = min(errors, key=lambda name: median(np.array(errors[name])))
            yield from (
                replace(row, method=BEST)
                for row in rows
                if (row.method, unit_of[row.hold_id]) == (chosen, left_out)
            )
