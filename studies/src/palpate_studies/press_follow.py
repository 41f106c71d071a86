"""A model's answers on a press, compared with the load cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from palpate.arrays import FloatArray
from palpate_studies.press_data import Press
from palpate_studies.press_models import Prediction


@dataclass(frozen=True, slots=True, kw_only=True)
class Followed:
    """A model's answer on a press, at each sample after the force was given.

    Attributes
    ----------
    press : Press
        The press.
    value_n, low_n, high_n : ndarray, shape (n_after,)
        Force and the ends of its interval, newtons.
    """

    press: Press
    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray

    @property
    def time_s(self) -> FloatArray:
        """Seconds since the force was given."""
        trace = self.press.trace
        return np.asarray(trace.time_s[trace.told + 1 :] - trace.time_s[trace.told])

    @property
    def truth_n(self) -> FloatArray:
        """Force of the load cell, newtons."""
        return self.press.trace.force_n[self.press.trace.told + 1 :]

    @property
    def log_error(self) -> FloatArray:
        """ln(estimated / true force)."""
        return np.asarray(np.log(self.value_n / self.truth_n))

    @property
    def last_held_log_error(self) -> float:
        """Error at the last sample before the release; of the first where none was held."""
        return float(self.log_error[max(self.press.last_held - self.press.trace.told - 1, 0)])

    @property
    def released(self) -> NDArray[np.bool_]:
        """Whether each sample comes after the last with as much force as given."""
        given = self.press.trace.told
        return np.arange(given + 1, len(self.press.trace.time_s)) > self.press.last_held

    @property
    def covered(self) -> NDArray[np.bool_]:
        """Whether the interval holds the true force."""
        return (self.low_n <= self.truth_n) & (self.truth_n <= self.high_n)


def in_newtons(press: Press, prediction: Prediction) -> Followed:
    """Return a model's answer in newtons, from the given force on."""
    given = press.trace.told
    change, half = (part[given + 1 :] for part in prediction)
    given_n = float(press.trace.force_n[given])
    return Followed(
        press=press,
        value_n=given_n * np.exp(change),
        low_n=given_n * np.exp(change - half),
        high_n=given_n * np.exp(change + half),
    )
