"""First-order lags, integrated exactly under targets that go in straight lines."""

from __future__ import annotations

import numpy as np

from palpate.arrays import FloatArray


def exact_step(rate: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return decay and mean decay over a step, for step / time constant = `rate`.

    >>> decay, mean = exact_step(np.array([0.0, 1.0]))
    >>> decay.round(3).tolist(), mean.round(3).tolist()
    ([1.0, 0.368], [1.0, 0.632])
    """
    rate = np.maximum(rate, 1e-12)
    fall = np.expm1(-rate)
    return 1.0 + fall, -fall / rate


def follow_line(
    value: FloatArray, *, start: FloatArray, end: FloatArray, rate: FloatArray
) -> FloatArray:
    """Return where first-order lags end up when their target goes in a line over one step.

    `value`: lags at the start of the step.
    `start`, `end`: target at both ends of the step.
    `rate`: step / time constant.
    """
    decay, mean = exact_step(rate)
    return end - mean * (end - start) - decay * (start - value)
