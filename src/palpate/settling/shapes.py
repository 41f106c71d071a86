"""Shapes of a hold: typical curves, and the possible deviation of a hold.

Two formulas, each with a reason: creep in log time and its tilted forms (viscoelastic solids,
carbon-black composites, slow loading), and decays, plain (the paper's equation 2) or stretched.
All components have the same prior odds: odds learned on four of five kinds of material were worse
on the fifth than even ones (`docs/prediction.md`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.arrays import FloatArray

#: A curve's change between these times is its unit: after contact, and at the paper's horizon, s.
UNIT_S = (0.3, 20.0)
#: Creep: the time added before the logarithm, s, and the tilt, the power of time that the pace per
#: e-fold of time grows with.
_CREEP_FROM_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
_TILTS = (1e-6, 0.15)
#: Decays: time constant, s, and the power of a stretched one.
_DECAYS = [
    *((float(tau_s), 1.0) for tau_s in np.geomspace(0.5, 6.0, 7)),
    *product((3.2, 12.8), (0.4, 0.55, 0.75)),
]
#: A decay in ln R depends on its share of the settled value; this is a usual one.
_DECAY_SHARE = 0.25
#: Where a loading is sampled, from its end back (Gauss and Legendre; denser towards the end).
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(12)
_BACK = ((_NODES + 1) / 2) ** 3
#: The load grows with the square of time: contacts stiffen as they close.
_LOADED = 3 * _WEIGHTS * ((_NODES + 1) / 2) ** 2 * (1 - _BACK)


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """Deviation of a hold from its curve; standard deviations are in units of its scale."""

    #: Of one sample.
    noise: float
    #: Gained per e-fold of time: waves and steps.
    walk: float
    #: Of the amplitude of decays of any time constant: another smooth shape.
    loose: float
    #: Contact adds a decay that is over in 0.3 s.
    fast: bool = False


#: Noise of one sample; how much a hold wanders from its curve (walk) and is another (loose).
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


def curve_values(time_s: FloatArray, *, loading_s: float = 0.0) -> FloatArray:
    """Return every curve at some times, falling, in units of its own change.

    `time_s`, shape (n_times,): seconds after the origin; the result is (n_times, n_curves).
    `loading_s`: how long the load took to grow before the origin: the curves of its parts add up.

    >>> start, end = curve_values(np.array(UNIT_S), loading_s=3.0)
    >>> bool(np.allclose(start - end, 1.0))
    True
    """
    times = np.concatenate([np.asarray(UNIT_S), time_s])
    if loading_s > 0:
        parts = [_curves(times + back * loading_s) for back in _BACK]
        curves = np.tensordot(_LOADED, np.stack(parts), axes=1)
    else:
        curves = _curves(times)
    scaled: FloatArray = curves[2:] / (curves[0] - curves[1])
    return scaled


def _curves(time_s: FloatArray) -> FloatArray:
    tilt, from_s = np.array(list(product(_TILTS, _CREEP_FROM_S))).T
    tau_s, power = np.array(_DECAYS).T
    times = time_s[:, None]
    # The difference of powers, so that no tilt is a plain logarithm.
    creep = -np.expm1(tilt * np.log(times + from_s)) / tilt
    decay = np.log1p(_DECAY_SHARE * np.exp(-((times / tau_s) ** power)))
    return np.concatenate([creep, decay], axis=1)
