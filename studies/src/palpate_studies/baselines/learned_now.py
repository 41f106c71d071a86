"""Learners of the force now, told the readings up to each frame and both calibrated laws.

They learn newtons, for newtons are scored, on other sheets that were calibrated and used in the
same way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import numpy as np

from palpate.arrays import FloatArray
from palpate.grasp.planning import laws_of
from palpate.sensor.calibration import ForcePairs
from palpate.signal.relative import total_excess
from palpate_studies.baselines.told_everything import LEARNERS, Answer, learned
from palpate_studies.protocol.parts import Learned

#: By learner.
NowLaws: TypeAlias = Mapping[str, Learned[Answer]]
#: Readings this long ago are shown, and the extremes within the last one, seconds.
_AGO_S = (0.07, 0.14, 0.27, 0.54, 1.1, 2.2, 4.4)
#: A reading that changed by this share within the second of those times has moved.
_MOVED, _WITHIN_S = 0.05, 0.14


def numbers_of(time_s: FloatArray, excess: FloatArray, *, pairs: ForcePairs) -> FloatArray:
    """Return what each frame and those before it show, shape (frames, numbers).

    Parameters
    ----------
    time_s : ndarray, shape (frames,)
        Times.
    excess : ndarray, shape (frames, rows, cols)
        Excess conductance of the pixels.
    pairs : ForcePairs
        Of the sheet's calibration.
    """
    reading, early, settled, _ = laws_of(pairs)
    read = np.asarray(reading.reading(excess), dtype=float)
    log = np.log(np.maximum(read, 1e-3))
    total = total_excess(excess)
    strongest = excess.max(axis=(1, 2)) / np.maximum(total, 0.01)
    forces_n = [np.asarray(law.force_n(read).value) for law in (early, settled)]
    ago = [_before(log, time_s, ago_s=ago_s) for ago_s in _AGO_S]
    recent = np.stack([log, *ago])
    return np.column_stack(
        [
            *forces_n,
            *np.log(np.maximum(forces_n, 0.01)),
            log,
            np.log1p(np.maximum(total, 0.0)),
            strongest,
            *(log - one for one in ago),
            recent.max(axis=0) - log,
            recent.min(axis=0) - log,
            _since_moved_s(log, time_s),
            time_s - time_s[0],
        ]
    )


def learned_now(rows: FloatArray, *, force_n: FloatArray, sheets: Sequence[str]) -> NowLaws:
    """Learn the force from frames of other sheets; arrays of shape (frames, ...)."""
    return {name: learned(name, rows, asked=force_n, seen=sheets) for name in LEARNERS}


def _before(log: FloatArray, time_s: FloatArray, *, ago_s: float) -> FloatArray:
    """Return the reading some time ago, or the first one."""
    index = np.searchsorted(time_s, time_s - ago_s + 1e-6, side="right") - 1
    return np.asarray(log[np.maximum(index, 0)])


def _since_moved_s(log: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return the time since the reading last moved, seconds."""
    moved = np.abs(log - _before(log, time_s, ago_s=_WITHIN_S)) > _MOVED
    last_s = np.maximum.accumulate(np.where(moved, time_s, time_s[0]))
    return np.asarray(time_s - last_s)
