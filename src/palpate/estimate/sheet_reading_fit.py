"""Choose how a sheet's pixels are added up: what predicts placements left out best."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from palpate.estimate.creep import CONTACT_EXCESS, FloatArray
from palpate.estimate.observer_fit import least_absolute
from palpate.estimate.sheet_memory import STILL_MM, SheetReading
from palpate.sensor.load_traces import LoadTraces

#: Exponents to choose from: the inverse of a pixel's own.
EXPONENTS = (0.5, 0.65, 0.8, 1.0, 1.25)
#: Below this the sheet hardly answers: such frames teach its faint end only, newtons.
FAINT_N = 0.2
#: Force below which errors count in newtons rather than in proportion, for the touch.
_FIRM_N = 0.3
#: A placement left out needs so many frames to judge by.
_FEWEST_FRAMES = 5


def best_reading(placements: Sequence[LoadTraces]) -> SheetReading:
    """Return the reading whose static curve predicts placements left out best.

    Parameters
    ----------
    placements : sequence of LoadTraces
        Each with frames above `FAINT_N`.
    """
    still = [_still(run) for run in placements]
    excess = [np.asarray(run.excess)[mine] for run, mine in zip(placements, still, strict=True)]
    force_n = [np.asarray(run.force_n)[mine] for run, mine in zip(placements, still, strict=True)]
    scores = {
        exponent: float(np.mean(_left_out_errors(exponent, excess, force_n)))
        for exponent in EXPONENTS
    }
    exponent = min(scores, key=scores.__getitem__)
    return _touched(exponent, np.concatenate(excess), np.concatenate(force_n))


def _still(run: LoadTraces) -> NDArray[np.bool_]:
    width_mm = np.asarray(run.width_mm)
    moved = np.abs(np.diff(width_mm, prepend=width_mm[0])) > STILL_MM
    return np.asarray(~moved & (np.asarray(run.force_n) > FAINT_N))


def _left_out_errors(
    exponent: float, excess: Sequence[FloatArray], force_n: Sequence[FloatArray]
) -> list[float]:
    found = []
    for place, (own, own_n) in enumerate(zip(excess, force_n, strict=True)):
        others = np.concatenate([*excess[:place], *excess[place + 1 :]])
        others_n = np.concatenate([*force_n[:place], *force_n[place + 1 :]])
        if len(own_n) < _FEWEST_FRAMES:
            continue
        reading = _touched(exponent, others, others_n)
        seen, asked = _curve(reading.of(others)), _curve(reading.of(own))
        weights = least_absolute(seen, np.log(others_n), np.ones(len(others_n)))
        found.append(float(np.mean(np.abs(asked @ weights - np.log(own_n)))))
    return found


def _curve(reading: FloatArray) -> FloatArray:
    """Return the terms of a parabola in logarithms: enough to compare readings by."""
    log_reading = np.log(reading + CONTACT_EXCESS)
    return np.stack([np.ones_like(log_reading), log_reading, log_reading**2], axis=-1)


def _touched(exponent: float, excess: FloatArray, force_n: FloatArray) -> SheetReading:
    """Return the reading of an exponent with the touch that makes it proportional to the force."""
    powers = SheetReading(exponent=exponent, touch=0.0).of(excess)
    touches = SheetReading(exponent=exponent, touch=1.0).of(excess) - powers
    design = np.stack([powers, touches], axis=1) / (force_n + _FIRM_N)[:, None]
    scale, touch = nnls(design, force_n / (force_n + _FIRM_N))[0]
    return SheetReading(exponent=exponent, touch=float(touch / scale) if scale > 0 else 0.0)
