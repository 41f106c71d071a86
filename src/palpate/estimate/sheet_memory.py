"""What ln force of a sheet is a weighted sum of: its reading now, its creep, its last movements."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from palpate.estimate.creep import CreepStates, FloatArray

#: The spike of a movement fades with about this time constant (paper, Figure 5).
_SPIKE_S = 0.09
#: After so much opening the sheet follows the force down; closing takes the slack up again faster,
#: because force rises steeper than it fell.
_BACKLASH_MM, _TAKE_UP = 0.5, 2.0
#: A change of the reported width below this is the encoder's.
STILL_MM = 0.06
#: Excess at which a pixel counts as half touched: the paper's contact threshold (section 4.1).
_TOUCHED_EXCESS = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetReading:
    """From the excess of each pixel to one number that hardly depends on how the load spreads.

    sum_i excess_i ** exponent + touch * sum_i excess_i / (excess_i + 0.1): the exponent undoes that
    of a pixel's law, so that forces add; a pixel that is touched at all carries its threshold.

    Attributes
    ----------
    exponent : float
        Inverse of a pixel's own.
    touch : float
        A pixel's threshold, in the unit of the sum.

    Examples
    --------
    >>> SheetReading(exponent=0.5, touch=0.0).of([4.0, 9.0, 0.0, float("nan")]).item()
    5.0
    """

    exponent: float
    touch: float

    def of(self, excess: ArrayLike) -> FloatArray:
        """Return the reading of frames, shape (..., pixels) to (...); dead pixels count nothing."""
        pixels = np.asarray(excess, dtype=float)
        load = np.where(pixels > 0, pixels, 0.0)
        touched = (load / (load + _TOUCHED_EXCESS)).sum(axis=-1)
        return np.asarray((load**self.exponent).sum(axis=-1) + self.touch * touched)


#: The plain sum of excess conductances.
SUMMED = SheetReading(exponent=1.0, touch=0.0)


def stretches(log_reading: ArrayLike, knots: tuple[float, ...]) -> FloatArray:
    """Return how far each stretch between knots is filled, shape (..., knots + 1).

    A sum of these with weights of one sign rises, and goes on in a line beyond both ends.

    Examples
    --------
    >>> stretches([-1.0, 2.5], (0.0, 2.0)).tolist()
    [[-1.0, 0.0, 0.0], [0.0, 2.0, 0.5]]
    """
    log_now = np.asarray(log_reading, dtype=float)[..., None]
    edges = np.array(knots)
    below = np.minimum(log_now, edges[0])
    between = np.clip(log_now - edges[:-1], 0.0, np.diff(edges))
    above = np.maximum(log_now - edges[-1], 0.0)
    return np.concatenate([below, between, above], axis=-1)


def terms_count(*, knots: tuple[float, ...], time_constants_s: tuple[float, ...]) -> int:
    """Return how many terms `SheetMemory` has.

    Examples
    --------
    >>> terms_count(knots=(0.0, 1.0), time_constants_s=())
    4
    """
    memory = len(time_constants_s) + 3 if time_constants_s else 0
    return 1 + len(knots) + 1 + memory


class _Movements:
    """The travel of the last closing and opening, fading, and the slack of hysteresis left."""

    def __init__(self) -> None:
        self._time_s = self._width_mm = float("nan")
        self.closed_mm = self.opened_mm = self.slack_mm = 0.0
        self.way = 0

    def step(self, time_s: float, width_mm: float) -> None:
        """Take the width at a time; NaN teaches nothing."""
        step_s, step_mm = time_s - self._time_s, width_mm - self._width_mm
        self._time_s, self._width_mm = time_s, width_mm
        self.way = 0
        if not math.isfinite(step_mm):
            return
        if abs(step_mm) > STILL_MM:
            self.way = 1 if step_mm < 0 else -1
        fading = math.exp(-step_s / _SPIKE_S)
        self.closed_mm *= fading
        self.opened_mm *= fading
        if self.way > 0:
            self.closed_mm -= step_mm
            self.slack_mm = max(self.slack_mm + _TAKE_UP * step_mm, 0.0)
        elif self.way < 0:
            self.opened_mm += step_mm
            self.slack_mm = min(self.slack_mm + step_mm, _BACKLASH_MM)

    @property
    def terms(self) -> tuple[float, float, float]:
        """What was closed, what was opened, and the slack, mm."""
        return self.closed_mm, self.opened_mm, self.slack_mm


class SheetMemory:
    """The terms that ln force is a weighted sum of, frame by frame or for a whole run at once.

    They are: 1, the stretches of the log reading, and for a sheet with memory the log reading less
    each of its low-passed copies, the travel of the last closing and opening (a spike of resistance
    stands against the rise of the force, and with its fall), and the slack of hysteresis.

    Attributes
    ----------
    way : int
        Which way the fingers moved in the last step: 1 closing, -1 opening, 0 not at all.
    log_reading : float
        ln(reading + 0.1) now.
    """

    def __init__(
        self,
        reading: SheetReading,
        *,
        knots: tuple[float, ...],
        time_constants_s: tuple[float, ...],
    ) -> None:
        self._reading, self._knots = reading, knots
        self._creep = CreepStates(time_constants_s=time_constants_s)
        self._remembers = bool(time_constants_s)
        self._movements = _Movements()
        self.way, self.log_reading = 0, -np.inf

    def step(self, time_s: float, excess: ArrayLike, *, width_mm: float) -> FloatArray:
        """Take one frame and return the terms, shape (n_terms,).

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        excess : array_like, shape (pixels,)
            Excess conductance of each pixel; NaN where a pixel is dead.
        width_mm : float
            Reported opening; NaN where unknown: then nothing is learned of movements.
        """
        states, movement = self._taken(time_s, self._reading.of(excess)[None], width_mm)
        self.log_reading = float(states[0])
        self.way = self._movements.way
        return self._terms(states, np.array(movement))

    def run(
        self, time_s: FloatArray, excess: FloatArray, *, width_mm: FloatArray
    ) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
        """Take the frames of a run; return terms, log readings, and the way of each step.

        The same as step by step, with the pixels of all frames summed in one go.

        Parameters
        ----------
        time_s, width_mm : ndarray, shape (n_times,)
            As in `step`.
        excess : ndarray, shape (n_times, pixels)
            As in `step`.
        """
        readings, found, ways = self._reading.of(excess)[:, None], [], []
        for now_s, reading, now_mm in zip(
            time_s.tolist(), readings, width_mm.tolist(), strict=True
        ):
            found.append(self._taken(now_s, reading, now_mm))
            ways.append(self._movements.way)
        states = np.stack([states for states, _ in found])
        terms = self._terms(states, np.array([movement for _, movement in found]))
        return terms, states[:, 0], np.array(ways)

    def _taken(
        self, time_s: float, reading: FloatArray, width_mm: float
    ) -> tuple[FloatArray, tuple[float, float, float]]:
        """Advance by one frame; return log reading with its copies, and terms of movements."""
        self._creep.step(time_s, reading)
        self._movements.step(time_s, width_mm)
        return self._creep.states[0].copy(), self._movements.terms

    def _terms(self, states: FloatArray, movement: FloatArray) -> FloatArray:
        """Put the terms together, shape (..., states) and (..., 3) to (..., n_terms)."""
        now = states[..., :1]
        terms = [np.ones_like(now), stretches(now[..., 0], self._knots)]
        if self._remembers:
            terms += [now - states[..., 1:], movement]
        return np.concatenate(terms, axis=-1)
