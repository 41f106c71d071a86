"""Holds of simple shapes, drawn as resistances with noise, to check predictors of settled values.

No recorded material has these shapes. They show what happens if one has.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from palpate.arrays import FloatArray
from palpate.holds import Hold

#: Sampling rate, and length beyond the paper's horizon of 20 s.
_RATE_HZ, _LENGTH_S = 15.0, 20.5
#: Noise of one sample, as a fraction of the reading.
_NOISE = (2e-4, 2e-3)


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _creep(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Fall by 5 to 30 % with the logarithm of time."""
    fall, from_s = _between(rng, 0.05, 0.3), _between(rng, 0.05, 1.0)
    return np.asarray(1 - fall * np.log1p(time_s / from_s) / np.log1p(20.0 / from_s))


def _single(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    size, tau_s = _between(rng, 0.05, 0.6), _between(rng, 0.4, 8.0)
    return np.asarray(1 + size * np.exp(-time_s / tau_s))


def _on_creep(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    size, tau_s = _between(rng, 0.05, 0.4), _between(rng, 0.4, 8.0)
    return _creep(time_s, rng) + size * np.exp(-time_s / tau_s)


def _power(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    from_s, exponent = _between(rng, 0.05, 0.5), _between(rng, 0.03, 0.3)
    return np.asarray((1 + time_s / from_s) ** -exponent)


def _stretched(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    size, tau_s = _between(rng, 0.05, 0.6), _between(rng, 0.7, 20.0)
    return np.asarray(1 + size * np.exp(-((time_s / tau_s) ** rng.uniform(0.3, 0.8))))


def _bounce(time_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    size, tau_s = _between(rng, 0.2, 1.0), _between(rng, 0.03, 0.12)
    ringing = np.abs(np.cos(np.pi * time_s / _between(rng, 0.06, 0.2)))
    return _creep(time_s, rng) + size * np.exp(-time_s / tau_s) * ringing


_SHAPES: Mapping[str, Callable[[FloatArray, np.random.Generator], FloatArray]] = MappingProxyType(
    {
        "single exponential": _single,
        "exponential on creep": _on_creep,
        "power of time": _power,
        "stretched exponential": _stretched,
        "bounce": _bounce,
    }
)


def draw_holds(count: int, *, seed: int) -> dict[str, list[Hold]]:
    """Draw `count` holds of each shape, by its name.

    >>> drawn = draw_holds(2, seed=1)
    >>> [(name, len(holds)) for name, holds in drawn.items()][:2]
    [('single exponential', 2), ('exponential on creep', 2)]
    """
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, _LENGTH_S, 1 / _RATE_HZ)
    return {
        name: [
            Hold(
                hold_id=str(number),
                channel=None,
                time_s=time_s,
                values=1000.0
                * draw_shape(time_s, rng)
                * (1 + _between(rng, *_NOISE) * rng.normal(size=time_s.size)),
            )
            for number in range(count)
        ]
        for name, draw_shape in _SHAPES.items()
    }
