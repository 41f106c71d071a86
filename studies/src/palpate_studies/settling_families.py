"""Holds drawn from families of shapes (no sensor, no twin): what users' recordings may look like.

Each family is a formula with ranges, fixed here once. The odds of the predictor are learned on one
seed of them, and reported on another.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold

#: Sampling rates met in practice, Hz, and how long a hold lasts, s.
RATES_HZ = (5.0, 13.0, 15.0, 30.0, 70.0)
LASTS_S = 20.5
Draw = Callable[[np.random.Generator, FloatArray], FloatArray]


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _ohm(rng: np.random.Generator, shape: FloatArray) -> FloatArray:
    """Return a shape as a noisy resistance of any size."""
    noisy = shape * (1 + _between(rng, 2e-4, 2e-3) * rng.normal(size=shape.size))
    return np.asarray(_between(rng, 20.0, 8000.0) * noisy)


def _published(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Relative change (percent) as both rows of the paper's Table 1 ask for."""
    mode, mode_s = 0.131 * np.exp(0.28 * rng.normal()), 1.96 * np.exp(0.37 * rng.normal())
    slow, log_rate = 0.068 + 0.026 * rng.normal(), 0.0103 + 0.0089 * rng.normal()
    ranges = ((46, 58), (52, 66), (58, 72), (13, 25))
    settled = -rng.uniform(*ranges[rng.integers(len(ranges))])
    times = np.append(time_s, 20.0)
    left = (
        0.37 * np.exp(-times / 0.086)
        + mode * np.exp(-((times / mode_s) ** 1.12))
        + slow * np.exp(-times / 17.2)
        - log_rate * np.log1p(times / 3.2)
    )
    return np.asarray(settled * (1 - left[:-1] + left[-1]) + rng.normal(0, 0.03, time_s.size))


def _tutorial(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw a decay of 1.5 s on log creep: the holds that `examples/offline_analysis.py` writes."""
    fast, slow = rng.uniform(0.1, 0.4), rng.uniform(0.02, 0.06)
    shape = 1 + fast * np.exp(-time_s / 1.5) - slow * np.log(time_s + 0.2)
    return np.asarray(rng.uniform(2e3, 6e3) * (shape + 0.001 * rng.normal(size=time_s.size)))


def _decay_on_creep(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw a decay of any time constant and share on log creep."""
    fast, slow, tau_s = _between(rng, 0.03, 0.4), _between(rng, 0.005, 0.06), _between(rng, 0.4, 6)
    return _ohm(rng, 1 + fast * np.exp(-time_s / tau_s) - slow * np.log(time_s + 0.2))


def _exponential(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw equation 2 of the paper."""
    return _ohm(rng, 1 + _between(rng, 0.05, 0.6) * np.exp(-time_s / _between(rng, 0.4, 8.0)))


def _power_law(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw a power law of time, half of them on a floor."""
    floor = rng.choice([0.0, rng.uniform(0.0, 0.5)])
    creep = (1 + time_s / _between(rng, 0.05, 1.0)) ** -rng.uniform(0.04, 0.2)
    return _ohm(rng, floor + (1 - floor) * creep)


def _stretched(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw a stretched exponential."""
    left = np.exp(-((time_s / _between(rng, 0.5, 10.0)) ** rng.uniform(0.35, 0.9)))
    return _ohm(rng, 1 + _between(rng, 0.05, 0.6) * left)


def _bounce(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw log creep after a contact that rings for 0.1 to 0.3 s."""
    slow, from_s = rng.uniform(0.02, 0.12), _between(rng, 0.1, 1.0)
    rung_s, height, rate_hz = rng.uniform(0.1, 0.3), _between(rng, 0.2, 3.0), rng.uniform(4, 15)
    ringing = np.abs(np.cos(np.pi * rate_hz * time_s + rng.uniform(0, 1)))
    log_r = -slow * np.log(time_s + from_s) + height * np.exp(-2 * time_s / rung_s) * ringing
    return _ohm(rng, np.exp(log_r))


def _two_decays(rng: np.random.Generator, time_s: FloatArray) -> FloatArray:
    """Draw a fast and a slow decay."""
    fast = _between(rng, 0.03, 0.4) * np.exp(-time_s / _between(rng, 0.2, 2.0))
    return _ohm(rng, 1 + fast + _between(rng, 0.03, 0.4) * np.exp(-time_s / _between(rng, 2, 12)))


FAMILIES: Mapping[str, Draw] = MappingProxyType(
    {
        "published": _published,
        "tutorial": _tutorial,
        "decay on creep": _decay_on_creep,
        "exponential": _exponential,
        "power law": _power_law,
        "stretched": _stretched,
        "bounce": _bounce,
        "two decays": _two_decays,
    }
)


def draw(family: str, count: int, *, seed: int) -> list[Hold]:
    """Draw holds of a family.

    Examples
    --------
    >>> hold, _ = draw("exponential", 2, seed=0)
    >>> hold.hold_id, hold.time_s[-1] > 20
    ('exponential-0', np.True_)
    """
    rng = np.random.default_rng([seed, *family.encode()])
    holds = []
    for number in range(count):
        time_s = np.arange(0.0, LASTS_S, 1 / rng.choice(RATES_HZ))
        values = FAMILIES[family](rng, time_s)
        holds.append(Hold(hold_id=f"{family}-{number}", channel=None, time_s=time_s, values=values))
    return holds


def after_baseline(hold: Hold, *, rng: np.random.Generator, rises_s: float = 0.0) -> Hold:
    """Return a hold with 0.5 to 3 s of the unloaded sensor in front, as a raw recording has it.

    The clock starts with the baseline; the settled value comes later by the length of the baseline.

    Parameters
    ----------
    hold : Hold
        Without baseline.
    rng : Generator
        Of its length, height and noise.
    rises_s : float
        The contact is made over this long, straight in ohm's logarithm or in percent.
    """
    step_s = float(np.median(np.diff(hold.time_s)))
    count = int(rng.uniform(0.5, 3.0) / step_s)
    positive = bool((hold.values > 0).all())
    rest = hold.values.max() * _between(rng, 1.5, 10.0) if positive else 0.0
    noise = 0.002 * (rest if positive else 15.0)
    baseline = rest + noise * rng.normal(size=count)
    # Contact falls anywhere between two samples.
    made = np.arange(rng.uniform(0.0, step_s), rises_s, step_s) / max(rises_s, step_s)
    first = hold.values[0]
    rise = rest * (first / rest) ** made if positive else made * first
    front = np.concatenate([baseline, rise])
    time_s = np.concatenate([np.arange(front.size) * step_s, hold.time_s + front.size * step_s])
    return Hold(
        hold_id=hold.hold_id,
        channel=hold.channel,
        time_s=time_s,
        values=np.concatenate([front, hold.values]),
    )
