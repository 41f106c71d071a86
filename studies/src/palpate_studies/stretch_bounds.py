"""What others could say of a stretched rubber's force: a clock alone, and all its history."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from palpate.arrays import FloatArray
from palpate.estimate.creep import CreepStates
from palpate.estimate.observer_fit import least_absolute
from palpate_studies.press_data import Press

#: The clock runs in ln(1 + seconds since told / this): relaxation is nearly even in it.
_CLOCK_S = 0.5
#: Name -> whether it reads the resistance.
BOUNDS: Mapping[str, bool] = {"clock, no sensor": False, "learner": True}


def bound_errors(stretches: Sequence[Press], *, reads: bool) -> Iterator[tuple[Press, FloatArray]]:
    """Return every stretch with its errors of ln force, learned from the other specimens.

    Parameters
    ----------
    stretches : sequence of Press
        Of at least two specimens.
    reads : bool
        Whether the history of the resistance is told, or the clock alone. Both are told the force
        once, and that the share that relaxes may depend on it.
    """
    for specimen in dict.fromkeys(one.trace.group for one in stretches):
        others = [one for one in stretches if one.trace.group != specimen]
        designs = [_design(one, reads=reads) for one in others]
        scale = np.std(np.concatenate(designs), axis=0)
        weights = least_absolute(
            np.concatenate(designs) / scale,
            np.concatenate([_log_change(one) for one in others]),
            np.concatenate([np.full(len(each), 1.0 / len(each)) for each in designs]),
        )
        for one in stretches:
            if one.trace.group == specimen:
                yield one, _design(one, reads=reads) / scale @ weights - _log_change(one)


def _log_change(stretch: Press) -> FloatArray:
    trace = stretch.trace
    return np.asarray(np.log(trace.force_n[trace.told + 1 :] / trace.force_n[trace.told]))


def _design(stretch: Press, *, reads: bool) -> FloatArray:
    """Return the terms at each sample after the force was told, and each times ln of that force."""
    trace = stretch.trace
    after = slice(trace.told + 1, None)
    since_s = trace.time_s[after] - trace.time_s[trace.told]
    terms = np.log1p(since_s / _CLOCK_S)[:, None]
    if reads:
        memory, states = CreepStates(), []
        for time_s, excess in zip(trace.time_s, trace.excess, strict=True):
            memory.step(float(time_s), [excess])
            states.append(memory.states[0].copy())
        terms = np.hstack([terms, np.array(states)[after] - states[trace.told]])
    return np.hstack([terms, terms * np.log(trace.force_n[trace.told])])
