"""Shapes of a hold: typical curves, and possible deviations from them.

There are two families of curves. Creep is a small power of time, nearly a logarithm, as in
viscoelastic solids and carbon-black composites. Decays are exponential (the paper's equation 2) or
stretched. All components have the same prior odds: sets and odds chosen on four of five kinds of
material were worse on the fifth kind than equal odds (`docs/prediction.md`).
"""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray

#: Creep: the time offset, s, and the power of time. With a power of 0 it would be a logarithm.
_CREEP_FROM_S = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2)
_CREEP_POWER = 0.12
#: Decays: time constant, s, and stretching exponent.
_DECAYS = (
    *((float(tau_s), 1.0) for tau_s in np.geomspace(0.5, 6.0, 7)),
    *product((3.2, 12.8), (0.4, 0.55, 0.75)),
)
#: Typical amplitude of a decay relative to the settled value, which affects its shape in ln R.
_DECAY_FRACTION = 0.25
#: Time offset, time constant and exponent of all curves, shape (n_curves,).
_FROM_S, _TAU_S, _POWER = np.array(
    [(from_s, 1.0, _CREEP_POWER) for from_s in _CREEP_FROM_S]
    + [(0.0, tau_s, stretching) for tau_s, stretching in _DECAYS]
).T
_N_CREEP, N_CURVES = len(_CREEP_FROM_S), _POWER.size
#: Which curves are single exponentials, shape (n_curves,).
IS_EXPONENTIAL: NDArray[np.bool_] = _POWER == 1

#: Deviations of a hold from its curve, standard deviations in units of the scale, shape
#: (n_deviations,): noise of one sample; random walk per e-fold of time (waves and steps); amplitude
#: of decays with any time constant (a different smooth shape).
NOISE = np.array([0.003, 0.003, 0.012, 0.012])
WALK = np.array([0.01, 0.02, 0.02, 0.1])
LOOSE = np.array([0.01, 0.08, 0.03, 0.03])


def _raw_curves(time_s: FloatArray) -> FloatArray:
    """Return curves of any size and sign, shape (n_times, n_curves)."""
    curves: FloatArray = ((time_s[:, None] + _FROM_S) / _TAU_S) ** _POWER
    curves[:, _N_CREEP:] = np.log1p(_DECAY_FRACTION * np.exp(-curves[:, _N_CREEP:]))
    return curves


#: Curves are normalised to their change between these times: after contact, and at the paper's
#: horizon, s.
UNIT_S = (0.3, 20.0)
_CHANGE = -np.diff(_raw_curves(np.array(UNIT_S)), axis=0)[0]


def curve_values(time_s: FloatArray) -> FloatArray:
    """Return all falling curves, normalised to their change, shape (n_times, n_curves).

    `time_s`, shape (n_times,): seconds after the origin.

    >>> start, end = curve_values(np.array(UNIT_S))
    >>> bool(np.allclose(start - end, 1.0))
    True
    """
    scaled: FloatArray = _raw_curves(time_s) / _CHANGE
    return scaled
