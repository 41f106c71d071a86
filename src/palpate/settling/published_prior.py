"""The prior of the paper's own sensor, as its Table 1 tells it.

Both rows of that table, the recorded value and one exponential, leave little choice for the mean
of its pixels. As a share of the settled value, what is left to come u seconds after the peak is

    0.37 exp(-u / 0.086) + a exp(-(u / b) ** 1.12) + s exp(-u / 17.2) - c ln(1 + u / 3.2)

with a = 0.131, b = 1.96 s, s = 0.068 and c = 0.0103 for a middling hold: one decay that stands out,
on slow creep. A sensor made as the paper's was may be like that; others are told apart by a few
samples.
"""

from __future__ import annotations

import numpy as np

from palpate.settling.prior import TIME_CONSTANTS_S, Prior
from palpate.settling.result import FloatArray

_ODDS = 0.3
#: Scale of the change between 0.3 and 20 s, as for the other structured holds.
_AMPLITUDE = 2.0
#: The decay that stands out: its time constants tried, their middle and scatter (log sd).
_MODES_S, _MODE_S, _MODE_LOG_SD = (0.95, 1.25, 1.55, 1.96, 2.45, 3.1, 4.0), 1.96, 0.37
#: exp(-(u/b) ** 1.12) as two exponentials: amplitudes and shares of b.
_STEEPER = ((1.216, 0.85), (-0.216, 0.30))
#: Amplitudes with their scatter (sd) from hold to hold: that decay, slow creep, log-time creep.
_MODE, _SLOW, _LOG_RATE = (0.131, 0.037), (0.068, 0.026), (0.0103, 0.0089)
_SLOW_S, _LOG_FROM_S = 17.2, 3.2
#: What happens right at contact.
_FAST, _FAST_S = (0.37, 0.037), 0.086
#: Leave for the decay that stands out to have another shape: sd of each amplitude near two seconds.
_LOOSE, _LOOSE_S, _LOOSE_LOG_SD = 0.06, 1.8, 0.8
_WALK, _NOISE_LEVELS = 0.006, (0.005, 0.02)


def _decay(tau_s: float) -> FloatArray:
    """Return one decay as amplitudes of the two time constants beside it."""
    log_tau = np.log(TIME_CONSTANTS_S)
    after = int(np.searchsorted(TIME_CONSTANTS_S, tau_s))
    share = (np.log(tau_s) - log_tau[after - 1]) / (log_tau[after] - log_tau[after - 1])
    weights = np.zeros(TIME_CONSTANTS_S.size)
    weights[after - 1 : after + 1] = 1.0 - share, share
    return weights


def _published() -> Prior:
    tau = TIME_CONSTANTS_S
    fast, slow = _decay(_FAST_S), _decay(_SLOW_S)
    # ln(1 + u/t) is the integral of (1 - exp(-u/tau)) exp(-t/tau) over ln tau.
    log_creep = np.log(tau[1] / tau[0]) * np.exp(-_LOG_FROM_S / tau)
    loose = _LOOSE**2 * np.exp(-((np.log(tau / _LOOSE_S) / _LOOSE_LOG_SD) ** 2))
    means, variances, odds = [], [], []
    for mode_s in _MODES_S:
        mode = sum((a * _decay(b * mode_s) for a, b in _STEEPER), np.zeros(tau.size))
        parts = ((fast, _FAST), (mode, _MODE), (slow, _SLOW), (log_creep, _LOG_RATE))
        mean = sum((amplitude * part for part, (amplitude, _) in parts), np.zeros(tau.size))
        variance = sum(((sd * part) ** 2 for part, (_, sd) in parts), np.zeros(tau.size))
        scale = _AMPLITUDE / (mean @ (np.exp(-0.3 / tau) - np.exp(-20.0 / tau)))
        means += len(_NOISE_LEVELS) * [scale * mean]
        variances += len(_NOISE_LEVELS) * [scale**2 * variance + loose]
        off_middle = np.log(mode_s / _MODE_S) / _MODE_LOG_SD
        odds += len(_NOISE_LEVELS) * [np.exp(-0.5 * off_middle**2)]
    count = len(odds)
    return Prior(
        mean_weights=np.array(means),
        weight_variance=np.array(variances),
        walk=np.full(count, _WALK),
        noise=np.tile(_NOISE_LEVELS, len(_MODES_S)),
        contact=np.zeros(count),
        log_weight=np.log(_ODDS * np.array(odds) / np.sum(odds)),
    )


PUBLISHED_PRIOR = _published()
