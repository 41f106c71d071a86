"""What ln force of a sheet is a weighted sum of: its reading now, its creep, its last movements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

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
        load = np.maximum(np.nan_to_num(np.asarray(excess, dtype=float)), 0.0)
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


class SheetMemory:
    """The terms that ln force is a weighted sum of, advanced frame by frame.

    They are: 1, the stretches of the log reading, and for a sheet with memory the log reading less
    each of its low-passed copies, the travel of the last movement, and the slack of hysteresis.

    Attributes
    ----------
    moved : bool
        Whether the fingers moved in the last step.
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
        self._time_s = self._width_mm = float("nan")
        self._travel_mm = self._slack_mm = 0.0
        self.moved, self.log_reading = False, -np.inf

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
        self._creep.step(time_s, self._reading.of(excess)[None])
        self._move(time_s, width_mm)
        states = self._creep.states[0]
        self.log_reading = float(states[0])
        terms = np.concatenate([[1.0], stretches(states[0], self._knots)])
        if not self._remembers:
            return terms
        return np.concatenate([terms, states[0] - states[1:], [self._travel_mm, self._slack_mm]])

    def _move(self, time_s: float, width_mm: float) -> None:
        step_s, step_mm = time_s - self._time_s, width_mm - self._width_mm
        self._time_s, self._width_mm = time_s, width_mm
        self.moved = False
        if not np.isfinite(step_mm):
            return
        self.moved = abs(step_mm) > STILL_MM
        travel_mm = abs(step_mm) if self.moved else 0.0
        self._travel_mm = self._travel_mm * float(np.exp(-step_s / _SPIKE_S)) + travel_mm
        if self.moved:
            opened_mm = step_mm if step_mm > 0 else _TAKE_UP * step_mm
            self._slack_mm = min(max(self._slack_mm + opened_mm, 0.0), _BACKLASH_MM)
