"""What is known of a hold before its first sample: how materials of this kind relax.

A hold is a sum of decays whose time constants are spread over log time, a fast process right after
contact, a slow random walk in log time and noise. Two families of such holds are thought possible,
and each hold's samples choose between them:

- *plain*: the decays are spread evenly beyond some shortest time constant and hardly deviate from
  that. Their sum is a smoothed -ln(t + t0). Carbon-black silicone is mostly like that.
- *structured*: the even spread is tilted (a power law), single decays deviate freely, one decay
  near two seconds may stand out (the paper's sensor: Table 1 asks for it), and a large fast process
  that says nothing of the rest may come first. It takes more samples to be sure of it.

All amplitudes are relative to one scale, the hold's own, and the offset is left free: nothing here
knows the unit of the values or where their zero is.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from palpate.settling.result import FloatArray

#: Time constants, s: from one sample of a fast sensor to creep far beyond any horizon.
TIME_CONSTANTS_S = np.geomspace(0.05, 400.0, 18)
TIME_CONSTANTS_S.setflags(write=False)
#: Noise of one sample, as shares of the change between 0.3 and 20 s: clean, usual, poor.
NOISE_LEVELS = (0.003, 0.012, 0.05)


@dataclass(frozen=True, slots=True, kw_only=True)
class Prior:
    """A mixture of Gaussian priors on the shape of a hold; shapes are (n_components, ...).

    Attributes
    ----------
    mean_weights : ndarray, shape (n_components, n_time_constants)
        Amplitudes of the decays that make up the component's typical curve.
    weight_variance : ndarray, shape (n_components, n_time_constants)
        Variance of each amplitude about the typical curve.
    walk : ndarray, shape (n_components,)
        Standard deviation that the random walk gains per e-fold of time.
    noise : ndarray, shape (n_components,)
        Standard deviation of one sample.
    log_weight : ndarray, shape (n_components,)
        Logarithm of the prior probability, up to a constant.
    """

    mean_weights: FloatArray
    weight_variance: FloatArray
    walk: FloatArray
    noise: FloatArray
    log_weight: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class _Component:
    """One member of a family, in the words of this file's docstring."""

    amplitude: float
    shortest_s: float
    tilt: float
    spread: float
    fast: float
    mode: float
    walk: float
    noise: float
    log_weight: float


def _plain() -> Iterable[_Component]:
    for shortest_s, spread, walk, noise in itertools.product(
        (0.3, 0.6, 1.1), (0.02, 0.06), (0.02, 0.06), NOISE_LEVELS
    ):
        yield _Component(
            amplitude=2.0,
            shortest_s=shortest_s,
            tilt=0.0,
            spread=spread,
            fast=0.25,
            mode=0.0,
            walk=walk,
            noise=noise,
            log_weight=1.5,
        )


def _structured() -> Iterable[_Component]:
    for shortest_s, tilt, mode, walk, noise in itertools.product(
        (0.07, 0.25, 0.9), (-0.05, -0.2, -0.35), (0.0, 0.6), (0.017, 0.068), NOISE_LEVELS
    ):
        yield _Component(
            amplitude=1.3,
            shortest_s=shortest_s,
            tilt=tilt,
            spread=0.4,
            fast=1.2,
            mode=mode,
            walk=walk,
            noise=noise,
            log_weight=1.9 if mode else 0.0,
        )


def _weights(component: _Component) -> tuple[FloatArray, FloatArray]:
    """Return mean and variance of the decays' amplitudes."""
    tau = TIME_CONSTANTS_S
    typical = np.exp(-component.shortest_s / tau) * tau**component.tilt
    typical /= typical @ (np.exp(-0.3 / tau) - np.exp(-20.0 / tau))
    # The fast process is over within a tenth of a second; the paper waits 0.5 s for it (t_a).
    fast = component.fast**2 / (1 + (tau / 0.055) ** 4)
    mode = component.mode**2 * np.exp(-0.5 * (np.log(tau / 2.25) / 0.57) ** 2)
    return component.amplitude * typical, (component.spread * typical) ** 2 + fast + mode


def _default_prior() -> Prior:
    components = [*_plain(), *_structured()]
    weights = [_weights(component) for component in components]
    return Prior(
        mean_weights=np.array([mean for mean, _ in weights]),
        weight_variance=np.array([variance for _, variance in weights]),
        walk=np.array([component.walk for component in components]),
        noise=np.array([component.noise for component in components]),
        log_weight=np.array([component.log_weight for component in components]),
    )


DEFAULT_PRIOR = _default_prior()
