"""Shapes of a hold: typical curves, and possible deviations from them.

There are two families of curves. Creep in log time and its tilted forms describe viscoelastic
solids and carbon-black composites. Decays are exponential (the paper's equation 2) or
stretched. All components have the same prior odds, because odds learned on four of five kinds of
material were worse on the fifth kind than equal odds (`docs/prediction.md`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.arrays import FloatArray

#: Curves are normalised to their change between these times: after contact, and at the paper's
#: horizon, s.
UNIT_S = (0.3, 20.0)
#: Creep: the time offset in the logarithm, s, and the tilt. The rate per e-fold of time grows with
#: time to the power of the tilt.
_CREEP_FROM_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
_TILTS = (1e-6, 0.15)
#: Decays: time constant, s, and stretching exponent.
_DECAYS = [
    *((float(tau_s), 1.0) for tau_s in np.geomspace(0.5, 6.0, 7)),
    *product((3.2, 12.8), (0.4, 0.55, 0.75)),
]
#: Typical amplitude of a decay relative to the settled value, which affects its shape in ln R.
_DECAY_FRACTION = 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """Deviation of a hold from its curve: standard deviations in units of the scale."""

    #: Noise of one sample.
    noise: float
    #: Random walk per e-fold of time: waves and steps.
    walk: float
    #: Amplitude of decays with any time constant: a different smooth shape.
    loose: float
    #: Whether contact adds a decay of less than 0.3 s.
    fast: bool = False


#: Levels of noise, and pairs of random walk and shape deviation (walk, loose).
_CLEAN, _USUAL, _POOR = 0.003, 0.012, 0.05
_STIFF, _SUPPLE, _FREE, _WAVY = (0.003, 0.003), (0.02, 0.03), (0.03, 0.1), (0.1, 0.03)

DEVIATIONS: tuple[Deviation, ...] = tuple(
    Deviation(noise=noise, walk=walk, loose=loose, fast=fast)
    for noise, (walk, loose), fast in (
        (_CLEAN, _STIFF, False),
        (_CLEAN, _SUPPLE, False),
        (_CLEAN, _FREE, False),
        (_USUAL, _SUPPLE, False),
        (_USUAL, _WAVY, False),
        (_POOR, _WAVY, False),
        (_USUAL, _WAVY, True),
    )
)
N_CURVES = len(_TILTS) * len(_CREEP_FROM_S) + len(_DECAYS)


def curve_values(time_s: FloatArray) -> FloatArray:
    """Return all falling curves, normalised to their change, shape (n_times, n_curves).

    `time_s`, shape (n_times,): seconds after the origin.

    >>> start, end = curve_values(np.array(UNIT_S))
    >>> bool(np.allclose(start - end, 1.0))
    True
    """
    tilt, from_s = np.array(list(product(_TILTS, _CREEP_FROM_S))).T
    tau_s, power = np.array(_DECAYS).T
    times = np.concatenate([np.asarray(UNIT_S), time_s])[:, None]
    # (t^tilt - 1) / tilt, which is a logarithm for tilt 0.
    creep = -np.expm1(tilt * np.log(times + from_s)) / tilt
    decay = np.log1p(_DECAY_FRACTION * np.exp(-((times / tau_s) ** power)))
    curves = np.concatenate([creep, decay], axis=1)
    scaled: FloatArray = curves[2:] / (curves[0] - curves[1])
    return scaled
