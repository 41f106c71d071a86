"""Simulated rubbers whose memory is of another form than any model of histories has.

Fixed before anything was scored on it. The models see low-passed copies of a reading: a memory that
fades exponentially. Here

- the resistance is that of a network of contacts that break at a strain of their own, earlier in
  fast motion, and close again at a smaller one after a delay of their own: relays, whose memory
  does not fade at all while nothing moves far enough;
- the force is that of a rubber that softens up to the largest strain it has seen, with friction
  that is the same at any speed, and relaxation by a power of time.

Each rubber is stretched like the recorded one, by a sawtooth with random turns, a sum of sines and
five sines; models learn from the other kinds of motion of the same rubber.
"""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray
from palpate.twin.ranges import log_uniform
from palpate_studies.history_data import History

#: Seed of everything drawn here.
SEED = 96_400
RUBBERS = 6
_RATE_HZ, _LENGTH_MM, _MOST_MM = 12.0, 40.0, 12.0
#: Seconds of each motion; turns of the sawtooth go at one of these speeds, mm/s.
_SAWTOOTH_S, _MULTISINE_S, _SINE_S, _SPEED_MM_PER_S = 180.0, 240.0, 60.0, (0.5, 4.0)
_PERIOD_S, _TONES = (5.0, 25.0), 6
#: Seconds in which the sum of sines is reached from rest.
_START_S = 5.0
#: Contacts: how many, at which strains they break and at which share of it they close, s after
#: which they do (as ranges), and by how much less strain they break per 1/s of its rate.
_CONTACTS, _BREAK, _CLOSE, _DELAY_S, _FASTER = (
    400,
    (0.02, 0.6),
    (0.4, 0.95),
    (0.1, 60.0),
    (0.2, 0.8),
)
#: Conductance as a power of the share of closed contacts above the least that conducts.
_POWER, _LEAST_SHARE, _REST_OHM = (1.4, 2.2), 0.2, (800.0, 1500.0)
#: Force of the rubber, N, at full stretch; shares lost to softening and held by friction; strain
#: over which the friction turns; exponent of the relaxation in time, its times, s, and share.
_FULL_N, _SOFTENS, _FRICTION, _TURN = (2.5, 4.0), (0.1, 0.3), (0.05, 0.15), 0.02
_RELAX_EXPONENT, _RELAX_S, _RELAX_SHARE = 0.3, np.geomspace(0.05, 500.0, 12), (0.05, 0.2)
#: Noise of the resistance as a share, and of the load cell, N.
_OHM_NOISE, _CELL_N = 2e-3, 0.01


def other_histories(rubber: int, *, seed: int = SEED) -> list[History]:
    """Return the recordings of one rubber, of three kinds of motion."""
    rng = np.random.default_rng([seed, rubber])
    motions = {"sawtooth-1": _sawtooth(rng), "multisine-1": _multisine(rng)}
    motions |= {f"sine-{letter}": _sine(rng) for letter in "abcde"}
    drawn = _Rubber(rng)
    return [drawn.stretched(f"{name}-rubber-{rubber}", at_mm) for name, at_mm in motions.items()]


class _Rubber:
    """One rubber: what chance gave to its contacts and to its force."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.breaks = rng.uniform(*_BREAK, _CONTACTS)
        self.closes = self.breaks * rng.uniform(*_CLOSE, _CONTACTS)
        self.delay_s = np.array([log_uniform(rng, _DELAY_S) for _ in range(_CONTACTS)])
        self.faster, self.power = rng.uniform(*_FASTER), rng.uniform(*_POWER)
        self.rest_ohm = log_uniform(rng, _REST_OHM)
        self.full_n = rng.uniform(*_FULL_N)
        self.softens, self.friction = rng.uniform(*_SOFTENS), rng.uniform(*_FRICTION)
        self.relaxes = rng.uniform(*_RELAX_SHARE)

    def stretched(self, name: str, at_mm: FloatArray) -> History:
        """Return the recording of one motion, from rest."""
        noise, cell = self.rng.standard_normal((2, at_mm.size))
        strain = at_mm / _LENGTH_MM
        force_n = self._force_n(strain) + _CELL_N * cell
        return History(
            recording_id=name,
            time_s=np.arange(at_mm.size) / _RATE_HZ,
            log_ohm=np.log(self._ohm(strain)) + _OHM_NOISE * noise,
            displacement_mm=at_mm,
            force_n=force_n - float(force_n[:3].mean()),
        )

    def _ohm(self, strain: FloatArray) -> FloatArray:
        rate_per_s = np.abs(np.gradient(strain)) * _RATE_HZ
        closed, below_s = np.ones(_CONTACTS, dtype=bool), np.zeros(_CONTACTS)
        share = np.empty(strain.size)
        for k, (stretch, rate) in enumerate(zip(strain, rate_per_s, strict=True)):
            broken = stretch > self.breaks - self.faster * rate
            below_s = np.where(stretch < self.closes, below_s + 1.0 / _RATE_HZ, 0.0)
            closed = (closed | (below_s > self.delay_s)) & ~broken
            share[k] = closed.mean()
        conducts = (np.maximum(share, 1.05 * _LEAST_SHARE) - _LEAST_SHARE) / (1.0 - _LEAST_SHARE)
        return np.asarray(self.rest_ohm * (1.0 + strain) ** 2 / conducts**self.power)

    def _force_n(self, strain: FloatArray) -> FloatArray:
        elastic = _rubber(strain) / _rubber(np.array(_MOST_MM / _LENGTH_MM))
        most = np.maximum.accumulate(strain) * _LENGTH_MM / _MOST_MM
        softened = elastic * (1.0 - self.softens * most)
        turned, rubbing = 0.0, np.empty(strain.size)
        for k, step in enumerate(np.diff(strain, prepend=0.0).tolist()):
            turned = min(max(turned + step / _TURN, -1.0), 1.0)
            rubbing[k] = turned
        weight = _RELAX_S**-_RELAX_EXPONENT
        relaxed = np.zeros(strain.size)
        for time_s, part in zip(_RELAX_S, weight / weight.sum(), strict=True):
            behind = -np.expm1(-1.0 / _RATE_HZ / time_s)
            lagging = 0.0
            for k, now in enumerate(softened.tolist()):
                lagging += behind * (now - lagging)
                relaxed[k] += part * lagging
        whole = softened - self.relaxes * relaxed + self.friction * rubbing
        return np.asarray(self.full_n * whole)


def _rubber(strain: FloatArray) -> FloatArray:
    """Return the stress of an ideal rubber at a strain, without unit."""
    stretch = 1.0 + strain
    return np.asarray(stretch - stretch**-2.0)


def _sawtooth(rng: np.random.Generator) -> FloatArray:
    at_mm = [0.0]
    while len(at_mm) < _SAWTOOTH_S * _RATE_HZ:
        step_mm = log_uniform(rng, _SPEED_MM_PER_S) / _RATE_HZ
        turn_mm = rng.uniform(0.0, _MOST_MM)
        count = max(round(abs(turn_mm - at_mm[-1]) / step_mm), 1)
        at_mm += np.linspace(at_mm[-1], turn_mm, count + 1)[1:].tolist()
    return np.array(at_mm)


def _multisine(rng: np.random.Generator) -> FloatArray:
    time_s = np.arange(0.0, _MULTISINE_S, 1.0 / _RATE_HZ)
    turns = [2.0 * np.pi / log_uniform(rng, _PERIOD_S) for _ in range(_TONES)]
    waves = sum(np.sin(turn * time_s + rng.uniform(0.0, 2.0 * np.pi)) for turn in turns)
    found = np.asarray(waves) - np.min(waves)
    at_mm = _MOST_MM * found / found.max()
    return np.concatenate([np.linspace(0.0, at_mm[0], round(_START_S * _RATE_HZ)), at_mm])


def _sine(rng: np.random.Generator) -> FloatArray:
    time_s = np.arange(0.0, _SINE_S, 1.0 / _RATE_HZ)
    turn = 2.0 * np.pi / log_uniform(rng, _PERIOD_S)
    return np.asarray(0.5 * _MOST_MM * (1.0 - np.cos(turn * time_s)))
