"""The shapes that a hold may have: typical curves, and how far a hold may deviate from one.

Each curve has a reason: creep in log time (carbon-black composites, viscoelastic solids with a flat
spectrum) and its tilted forms (power laws), decays of one time constant (the paper's equation 2),
decays on creep, decays of spread time constants (stretched), two decays, and the paper's own sensor
as both rows of its Table 1 describe it. A deviation gives how noisy, how wavy and how free a hold
is around its curve, and whether making contact adds something before anything relaxes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.arrays import FloatArray

#: A curve's change between these times is its unit: after contact, and at the paper's horizon, s.
UNIT_S = (0.3, 20.0)
#: Creep under a decay sets in at about the length of the contact transient, s.
_CREEP_FROM_S = 0.3
#: Shares of the settled value, with the paper's sensor as in its Table 1 (docs/prediction.md):
#: the contact transient, the decay that stands out, slow creep, and log-time creep.
_PUBLISHED = {"fast": 0.37, "mode": 0.131, "slow": 0.068, "log_rate": 0.0103}
_PUBLISHED_FAST_S, _PUBLISHED_SLOW_S, _PUBLISHED_LOG_S, _PUBLISHED_POWER = 0.086, 17.2, 3.2, 1.12
#: A small decay is the same curve in R and in ln R; a usual one is this share of the settled value.
_SMALL, _USUAL_SHARE = 0.02, 0.25


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """How a hold differs from its curve; all standard deviations are in units of its scale."""

    #: Of one sample.
    noise: float
    #: Gained per e-fold of time: waves and steps.
    walk: float
    #: Of the amplitude of decays of any time constant: another smooth shape.
    loose: float
    #: Contact adds a decay that is over in 0.3 s.
    fast: bool = False


def _creep(time_s: FloatArray, from_s: FloatArray) -> FloatArray:
    return np.asarray(-np.log(time_s + from_s))


def _tilted_creep(time_s: FloatArray, bend: FloatArray, from_s: FloatArray) -> FloatArray:
    return np.asarray(-((time_s + from_s) ** bend) / bend)


def _decay(
    time_s: FloatArray, tau_s: FloatArray, power: FloatArray, share: FloatArray
) -> FloatArray:
    return np.asarray(np.log1p(share * np.exp(-((time_s / tau_s) ** power))))


def _decay_on_creep(time_s: FloatArray, tau_s: FloatArray, ratio: FloatArray) -> FloatArray:
    creep = -np.log(time_s + _CREEP_FROM_S) / np.log(UNIT_S[1] / _CREEP_FROM_S)
    return np.asarray(ratio * np.exp(-time_s / tau_s) + creep)


def _two_decays(time_s: FloatArray, fast_s: FloatArray, slow_s: FloatArray) -> FloatArray:
    left = (np.exp(-time_s / fast_s) + np.exp(-time_s / slow_s)) / 2
    return np.asarray(np.log1p(_USUAL_SHARE * left))


def _published(time_s: FloatArray, mode_s: FloatArray) -> FloatArray:
    return np.asarray(
        _PUBLISHED["fast"] * np.exp(-time_s / _PUBLISHED_FAST_S)
        + _PUBLISHED["mode"] * np.exp(-((time_s / mode_s) ** _PUBLISHED_POWER))
        + _PUBLISHED["slow"] * np.exp(-time_s / _PUBLISHED_SLOW_S)
        - _PUBLISHED["log_rate"] * np.log1p(time_s / _PUBLISHED_LOG_S)
    )


#: Families of typical curves, falling, in any unit: from times after the origin (s) and parameters,
#: one row for each curve, to values.
_FAMILIES: tuple[tuple[Callable[..., FloatArray], list[tuple[float, ...]]], ...] = (
    (_creep, [(0.05,), (0.1,), (0.2,), (0.4,), (0.8,)]),
    (_tilted_creep, [(0.06, 0.1), (0.06, 0.2), (0.06, 0.4), (0.06, 0.8), (0.3, 0.2)]),
    (_decay, [(float(tau_s), 1.0, _USUAL_SHARE) for tau_s in np.geomspace(0.5, 6.0, 7)]),
    (_decay_on_creep, list(product((0.6, 1.0, 1.7, 3.0), (0.4, 1.2, 3.0)))),
    (_decay_on_creep, list(product((5.0, 9.0), (0.4, 1.2)))),
    (_decay, list(product((0.8, 1.6, 3.2, 6.4), (0.4, 0.5, 0.6, 0.75), (_USUAL_SHARE,)))),
    (_decay, [(10.0, 0.5, _SMALL)]),
    (_two_decays, list(product((0.3, 0.8, 1.6), (3.0, 6.0, 10.0)))),
    (_published, [(0.95,), (1.3,), (1.7,), (2.2,)]),
)
N_CURVES = sum(len(rows) for _, rows in _FAMILIES)

#: Noise of one sample; how much a hold wanders from its curve (walk) and is another (loose).
_CLEAN, _USUAL, _POOR = 0.003, 0.012, 0.05
_STIFF, _GIVING, _FREE, _WAVY = (0.003, 0.003), (0.01, 0.03), (0.03, 0.15), (0.1, 0.03)

DEVIATIONS: tuple[Deviation, ...] = tuple(
    Deviation(noise=noise, walk=walk, loose=loose, fast=fast)
    for noise, (walk, loose), fast in (
        (_CLEAN, _STIFF, False),
        (_CLEAN, _GIVING, False),
        (_CLEAN, _FREE, False),
        (_USUAL, _GIVING, False),
        (_USUAL, _WAVY, False),
        (_POOR, _WAVY, False),
        (_USUAL, _WAVY, True),
    )
)


def curve_values(time_s: FloatArray) -> FloatArray:
    """Return every curve at some times, in units of its own change.

    Shapes: times (n_times,), result (n_times, n_curves).

    >>> start, end = curve_values(np.array(UNIT_S))
    >>> bool(np.allclose(start - end, 1.0))
    True
    """
    scaled: FloatArray = _unscaled(time_s) / _CHANGE
    return scaled


def _unscaled(time_s: FloatArray) -> FloatArray:
    """Return every curve in the unit of its family, shape (n_times, n_curves)."""
    times = time_s[:, None]
    return np.concatenate([curves(times, *rows) for curves, rows in _PARAMETERS], axis=1)


_PARAMETERS = tuple((curves, np.array(rows).T) for curves, rows in _FAMILIES)
#: Change of each curve between the times that make its unit.
_CHANGE: FloatArray = -np.diff(_unscaled(np.array(UNIT_S)), axis=0)
