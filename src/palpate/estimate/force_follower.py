"""Force at every frame by the dead-weight law, and which weight would narrow it most."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtri

from palpate.estimate.force_law import ForceLaw, build_settled_inputs
from palpate.estimate.force_states import ForceStates, log_reading
from palpate.estimate.measurement import Measurement
from palpate.signal.relative import CONTACT_PERCENT

#: A pixel is touched from this excess conductance on (paper, section 4.1, as conductance), and let
#: go below half of it.
_TOUCHED = 1.0 / (1.0 + CONTACT_PERCENT / 100.0) - 1.0
#: A pixel that reads short counts as this excess; beyond every calibration.
_MOST_EXCESS = 1e5
#: Forces at which a calibration by weights reports its interval, and begins, newtons: spread over
#: the range of a gripper (three such weights: error of real ladders .20 in ln force, first weights
#: of 0.6 to 1.2 N 1.0).
SPREAD_N = (1.5, 4.0, 9.0)
#: Range of the search for a force's reading: 0.2 to 20 000 times the rest conductance.
_READINGS = np.geomspace(0.2, 2e4, 400)


class ForceSource(Protocol):
    """Anything that turns frames into the force now."""

    def step(self, time_s: float, excess: ArrayLike) -> Measurement:
        """Take a frame, shape (rows, cols), and return the force now."""
        ...


class TouchDetector:
    """Whether any pixel is touched, with hysteresis.

    >>> watch = TouchDetector()
    >>> [watch.step([[excess]]) for excess in (0.05, 0.2, 0.08, 0.02)]
    [False, True, True, False]
    """

    def __init__(self) -> None:
        self._touched = False

    def step(self, excess: ArrayLike) -> bool:
        """Return whether a frame shows a touch; `excess` of shape (rows, cols)."""
        highest = float(np.nanmax(np.asarray(excess, dtype=float), initial=0.0))
        self._touched = highest > _TOUCHED * (0.5 if self._touched else 1.0)
        return self._touched


class ForceFollower:
    """Newtons with an interval at every frame, from the summed excess conductance and its history.

    Without any known force the law is that of other sensors, and the interval is wide:

    >>> follower = ForceFollower(ForceLaw())
    >>> follower.step(0.0, [[0.0, 0.01]]).value
    0.0
    >>> answer = follower.step(0.1, [[12.0, 8.0]])
    >>> 0 < answer.low < answer.value < answer.high
    True
    """

    def __init__(self, law: ForceLaw) -> None:
        self._law, self._states, self._touch = law, ForceStates(), TouchDetector()

    def step(self, time_s: float, excess: ArrayLike) -> Measurement:
        """Take a frame and return the force now; 0 with an upper end without contact.

        `time_s`: not earlier than the last one.
        `excess`, shape (rows, cols): excess conductance of each pixel; NaN where one does not read.
        """
        grid = np.minimum(np.asarray(excess, dtype=float), _MOST_EXCESS)
        inputs = self._states.step(time_s, float(log_reading(np.nansum(grid))))
        return self._law.force(inputs, touched=self._touch.step(grid))


def half_width_percent(law: ForceLaw, force_n: float) -> float:
    """Return half of the 90 % interval of a settled force, percent of it.

    >>> known = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    >>> half_width_percent(known, 4.0) < 0.5 * half_width_percent(ForceLaw(), 4.0)
    True
    """
    (_,), (sd,) = law.log_force(build_settled_inputs(_reading_at(law, force_n)))
    return float(100.0 * np.sinh(float(ndtri(0.95)) * sd))


def most_useful_n(law: ForceLaw, *, loads_n: Sequence[float] = SPREAD_N) -> float:
    """Return the load whose weighing would narrow the intervals most, newtons.

    >>> most_useful_n(ForceLaw.fit([4.0, 5.0], force_n=[1.5, 1.6]))
    9.0
    """

    def half_width_after(load_n: float) -> float:
        reading = _reading_at(law, load_n)
        (log_n,), _ = law.log_force(build_settled_inputs(reading))
        after = law.copy().update(reading, force_n=float(np.exp(log_n)))
        return sum(half_width_percent(after, at_n) for at_n in SPREAD_N)

    return min(loads_n, key=half_width_after)


def _reading_at(law: ForceLaw, force_n: float) -> float:
    """Return the settled excess conductance at which the law shows a force."""
    log_n = law.log_force(build_settled_inputs(_READINGS))[0]
    return float(_READINGS[np.argmin(np.abs(log_n - np.log(force_n)))])
