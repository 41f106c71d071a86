"""Every method on the holds of one file; ours also calibrated, on other specimens alone."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from palpate.errors import InputError
from palpate.holds import Hold, read_holds
from palpate.settling.evaluate import Prediction, predict_holds
from palpate.settling.exponential import Exponential
from palpate.settling.log_law import LogLaw
from palpate.settling.recorded import Recorded
from palpate.settling.relaxation import Relaxation
from palpate.settling.result import SettlingMethod
from palpate.settling.scoring import settled_value
from palpate_studies.specimens import FEWEST_SPECIMENS, predict_held_out, specimen_of

CUTOFFS_S = (1.0, 2.0, 2.5, 3.0, 5.0, 8.0, 10.0, 15.0)
HORIZON_S = 20.0
LEVEL = 0.9

#: The paper's choice of cut-off: the tables of specimens and of the worst holds are made there.
MAIN_CUTOFF_S = 2.5
OURS, CALIBRATED = "relaxation", "calibrated"


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
    """Return what ours has to beat: waiting, the paper's exponential and a plain log law."""
    methods: tuple[SettlingMethod, ...] = (Recorded(), Exponential(), LogLaw())
    return {method.name: method for method in methods}


def analyse(file: Path, *, pattern: re.Pattern[str] | None = None) -> FileResult:
    """Predict every hold of a file with every method, ours also calibrated on other specimens.

    Raises
    ------
    InputError
        If no hold of the file reaches the horizon.
    """
    holds = [
        hold
        for hold in read_holds(file, until_s=HORIZON_S)
        if np.isfinite(settled_value(hold.time_s, hold.values, horizon_s=HORIZON_S))
    ]
    if not holds:
        raise InputError(f"{file}: no hold reaches {HORIZON_S:g} s, so none can be scored")
    specimens = {hold.hold_id: specimen_of(hold.hold_id, pattern=pattern) for hold in holds}
    enough = len(set(specimens.values())) >= FEWEST_SPECIMENS
    grid: dict[str, Any] = {"cutoffs_s": CUTOFFS_S, "horizon_s": HORIZON_S, "level": LEVEL}
    methods = baselines() | {OURS: Relaxation()}
    calibrated = predict_held_out(
        holds,
        units=[specimens[hold.hold_id] if enough else hold.hold_id for hold in holds],
        calibrate=lambda others: Relaxation().calibrated_on(others, horizon_s=HORIZON_S),
        name=CALIBRATED,
        **grid,
    )
    return FileResult(
        name=file.name,
        holds=holds,
        specimens=specimens,
        unit="specimen" if enough else "hold",
        predictions=[*predict_holds(holds, methods=methods, **grid), *calibrated],
    )
