"""The shapes that a hold may have: typical curves, and how far a hold may deviate from one.

Each curve has a reason: creep in log time (carbon-black composites, viscoelastic solids with a flat
spectrum) and its tilted forms (power laws), decays of one time constant (the paper's equation 2),
decays on creep, decays of spread time constants (stretched), and the paper's own sensor as both
rows of its Table 1 describe it. A deviation says how noisy, how wavy and how free a hold is around
its curve, and what making contact adds before anything relaxes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np

from palpate.settling.result import FloatArray

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
#: When a bounce at contact is over, s: a light touch, and a hard one.
BOUNCES_S = (0.12, 0.35)


@dataclass(frozen=True, slots=True, kw_only=True)
class Curve:
    """One typical curve, falling, in any unit.

    Attributes
    ----------
    kind, name : str
        Its family, and what tells it from the others of the family.
    at : callable
        From times after the origin (s) to values.
    """

    kind: str
    name: str
    at: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """How a hold differs from its curve; all standard deviations are in units of its scale.

    Attributes
    ----------
    noise : float
        Of one sample.
    walk : float
        Gained per e-fold of time: waves and steps.
    loose : float
        Of the amplitude of decays of any time constant: another smooth shape.
    fast : bool
        Contact adds a decay that is over in 0.3 s.
    bounce_s : float
        Until when contact bounces and a reading says nothing; 0 where it does not.
    """

    noise: float
    walk: float
    loose: float
    fast: bool = False
    bounce_s: float = 0.0


def _creep(bend: float, from_s: float) -> Curve:
    def at(time_s: FloatArray) -> FloatArray:
        log_time = np.log(time_s + from_s)
        return np.asarray(-np.expm1(bend * log_time) / bend if bend else -log_time)

    return Curve(kind="creep", name=f"{bend:g}, {from_s:g} s", at=at)


def _decay(tau_s: float, power: float, share: float) -> Curve:
    def at(time_s: FloatArray) -> FloatArray:
        return np.asarray(np.log1p(share * np.exp(-((time_s / tau_s) ** power))))

    return Curve(kind="decay", name=f"{tau_s:.2g} s, {power:g}, {share:g}", at=at)


def _decay_on_creep(tau_s: float, ratio: float) -> Curve:
    def at(time_s: FloatArray) -> FloatArray:
        creep = -np.log(time_s + _CREEP_FROM_S) / np.log(UNIT_S[1] / _CREEP_FROM_S)
        return np.asarray(ratio * np.exp(-time_s / tau_s) + creep)

    return Curve(kind="decay on creep", name=f"{tau_s:.2g} s, {ratio:g}", at=at)


def _published(mode_s: float) -> Curve:
    def at(time_s: FloatArray) -> FloatArray:
        return np.asarray(
            _PUBLISHED["fast"] * np.exp(-time_s / _PUBLISHED_FAST_S)
            + _PUBLISHED["mode"] * np.exp(-((time_s / mode_s) ** _PUBLISHED_POWER))
            + _PUBLISHED["slow"] * np.exp(-time_s / _PUBLISHED_SLOW_S)
            - _PUBLISHED["log_rate"] * np.log1p(time_s / _PUBLISHED_LOG_S)
        )

    return Curve(kind="published", name=f"{mode_s:g} s", at=at)


CURVES: tuple[Curve, ...] = (
    *(_creep(0.0, from_s) for from_s in (0.05, 0.1, 0.2, 0.4, 0.8, 1.6)),
    *(_creep(bend, from_s) for bend, from_s in product((-0.15, -0.4), (0.1, 0.8))),
    *(_creep(bend, from_s) for bend, from_s in product((0.15, 0.3), (0.2,))),
    *(_decay(float(tau_s), 1.0, _USUAL_SHARE) for tau_s in np.geomspace(0.4, 12.0, 11)),
    *(
        _decay_on_creep(float(tau_s), ratio)
        for tau_s, ratio in product(np.geomspace(0.4, 9.0, 7), (0.4, 1.2, 3.0))
    ),
    *(_decay(tau_s, 0.5, _SMALL) for tau_s in (0.6, 2.4, 10.0)),
    *(_decay(tau_s, 0.75, _SMALL) for tau_s in (0.6, 1.6, 4.0, 10.0)),
    *(_decay(tau_s, 1.4, _SMALL) for tau_s in (2.4, 5.0)),
    *(_published(mode_s) for mode_s in (0.95, 1.3, 1.7, 2.2, 2.9, 3.8)),
)

#: Noise of one sample; the worst is as large as what it hides.
_CLEAN, _USUAL, _POOR, WORST_NOISE = 0.003, 0.012, 0.05, 0.2
_STIFF, _GIVING, _FREE, _WAVY = (0.003, 0.003), (0.01, 0.03), (0.03, 0.15), (0.1, 0.03)


def _deviations() -> tuple[Deviation, ...]:
    calm = [
        (_CLEAN, _STIFF),
        (_CLEAN, _GIVING),
        (_CLEAN, _FREE),
        (_CLEAN, _WAVY),
        (_USUAL, _STIFF),
        (_USUAL, _GIVING),
        (_USUAL, _WAVY),
        (_POOR, _GIVING),
        (_POOR, _FREE),
        (_POOR, _WAVY),
        (WORST_NOISE, _GIVING),
        (WORST_NOISE, _WAVY),
    ]
    fast = [(_CLEAN, _GIVING), (_USUAL, _WAVY)]
    bouncing = [(_CLEAN, _STIFF), (_USUAL, _GIVING)]
    return (
        *(Deviation(noise=noise, walk=w, loose=free) for noise, (w, free) in calm),
        *(Deviation(noise=noise, walk=w, loose=free, fast=True) for noise, (w, free) in fast),
        *(
            Deviation(noise=noise, walk=w, loose=free, bounce_s=until_s)
            for until_s, (noise, (w, free)) in product(BOUNCES_S, bouncing)
        ),
    )


DEVIATIONS = _deviations()


def curve_values(time_s: FloatArray) -> FloatArray:
    """Return every curve at some times, in units of its own change.

    Parameters
    ----------
    time_s : ndarray, shape (n_times,)
        Seconds after the origin.

    Returns
    -------
    ndarray, shape (n_times, n_curves)

    Examples
    --------
    >>> start, end = curve_values(np.array(UNIT_S))
    >>> bool(np.allclose(start - end, 1.0))
    True
    """
    times = np.concatenate([np.array(UNIT_S), time_s])
    values = np.empty((times.size, len(CURVES)))
    for column, curve in zip(values.T, CURVES, strict=True):
        column[:] = curve.at(times)
    scaled: FloatArray = values[2:] / (values[0] - values[1])
    return scaled
