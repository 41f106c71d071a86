"""States of a sheet's pixels: readings, lags, plays and touch, updated frame by frame.

A sheet responds to a force at once, and then creeps. One reading therefore belongs to many forces,
but a reading with its history to few. With the excess conductance x_i = G/G0 - 1 of pixel i and
v_i = ln(1 + x_i):

    l_i  = ln(x_i + 0.1)                                      reading
    r_i (v_i - v_ik),  r_i = (1 + x_i) / (x_i + 0.3)          lag behind copy k
    u_j  = min(fall of ln(sum x + 0.1) from its maximum, width_j) / width_j     play
    s_i  = touch of the pixel relative to the most touched one, times that of the sheet, 0 to 1

v_ik is a low-passed copy of v_i with time constant k: creep is linear in v, and ln force is steep
in v at small readings. A play is 0 while the reading rises and 1 once it fell by its width
(Prandtl-Ishlinskii), which tells unloading from loading. All states are causal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from palpate.arrays import FloatArray
from palpate.force.force_states import CONTACT_EXCESS, TIME_CONSTANTS_S

#: Time constants of the copies, seconds.
_TAU_S = np.array(TIME_CONSTANTS_S)
#: Widths of the plays (ln reading); log-spaced.
PLAY_WIDTHS = np.array([0.1, 0.4, 1.5])
N_LAGS, N_PLAYS = _TAU_S.size, PLAY_WIDTHS.size
#: Excess of the noise at rest, and of the beginning of a touch.
_NOISE_EXCESS, ONSET_EXCESS = 0.004, 0.02
#: Excess below which ln force is steep in v.
_STEEP_EXCESS = 0.3
#: Touch of a pixel without any reading, so that the force of an empty hand has a logarithm.
_LEAST_TOUCH = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class States:
    """States of n frames.

    `log_x`, `touch`: shape (n, pixels). `lag`: shape (n, pixels, N_LAGS). `play`: shape
    (n, N_PLAYS).
    """

    log_x: FloatArray
    lag: FloatArray
    touch: FloatArray
    play: FloatArray


class SheetHistory:
    """Follows the pixels of one sheet from frame to frame.

    Examples
    --------
    The lag behind the slowest copy is largest just after a step:

    >>> history = SheetHistory()
    >>> [float(history.step(t, [x]).lag[0, 0, -1].round(2)) for t, x in ((0, 0), (1, 3), (2, 3))]
    [0.0, 1.2, 0.86]
    """

    def __init__(self) -> None:
        self._time_s: float | None = None
        self._copies = self._upper = np.empty(0)

    def step(self, time_s: float, excess: ArrayLike) -> States:
        """Process a frame and return its states.

        `time_s`: not earlier than that of the last frame.
        `excess`, shape (pixels,) or (rows, cols): NaN for pixels without a reading.
        Raises `ValueError` if time runs backwards.
        """
        log_x, touch, v, steepness, log_sum = _read(np.asarray(excess, dtype=float).ravel())
        total = float(log_sum)
        if self._time_s is None:
            self._copies = np.repeat(v[:, None], N_LAGS, axis=1)
            self._upper = np.full(N_PLAYS, total)
        else:
            elapsed_s = time_s - self._time_s
            if elapsed_s < 0:
                raise ValueError(f"time runs backwards: from {self._time_s} s to {time_s} s")
            self._copies += -np.expm1(-elapsed_s / _TAU_S) * (v[:, None] - self._copies)
            self._upper = np.minimum(np.maximum(self._upper, total), total + PLAY_WIDTHS)
        self._time_s = time_s
        lag = steepness[:, None] * (v[:, None] - self._copies)
        play = (self._upper - total) / PLAY_WIDTHS
        return States(log_x=log_x[None], lag=lag[None], touch=touch[None], play=play[None])


def compute_states(time_s: ArrayLike, excess: ArrayLike) -> States:
    """Return the states of a recording from before the contact on.

    `time_s`, shape (n,); `excess`, shape (n, pixels) or (n, rows, cols).
    """
    history = SheetHistory()
    steps = zip(np.asarray(time_s, dtype=float).tolist(), np.asarray(excess), strict=True)
    found = [history.step(at_s, frame) for at_s, frame in steps]
    return States(
        **{name: np.concatenate([getattr(one, name) for one in found]) for name in States.__slots__}
    )


def build_settled_states(excess: ArrayLike) -> States:
    """Return the states of settled readings: without lag, and not unloading.

    `excess`, shape (n, pixels) or (n, rows, cols).

    >>> build_settled_states([[0.9, 0.0]]).lag.any().item()
    False
    """
    frames = np.asarray(excess, dtype=float)
    log_x, touch, v, _, _ = _read(frames.reshape(len(frames), -1))
    return States(
        log_x=log_x,
        lag=np.zeros((*v.shape, N_LAGS)),
        touch=touch,
        play=np.zeros((len(v), N_PLAYS)),
    )


def _read(excess: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return reading, touch, v, and steepness of each pixel, and ln of the sum.

    `excess`, shape (..., pixels).
    """
    v = np.log1p(np.maximum(np.nan_to_num(excess), 0.0))
    # Many pixels at rest would otherwise add up to a touch.
    x = np.maximum(np.expm1(v) - (_NOISE_EXCESS if v.shape[-1] > 1 else 0.0), 0.0)
    log_x = np.log(x + CONTACT_EXCESS)
    touch = _LEAST_TOUCH - np.expm1(-x / ONSET_EXCESS)
    steepness = (1.0 + x) / (x + _STEEP_EXCESS)
    total = np.asarray(np.log(x.sum(axis=-1) + CONTACT_EXCESS))
    of_sheet = _LEAST_TOUCH - np.expm1(-x.sum(axis=-1, keepdims=True) / ONSET_EXCESS)
    touch *= of_sheet / touch.max(axis=-1, keepdims=True)
    return log_x, touch, v, steepness, total
