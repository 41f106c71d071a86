"""Force at every frame from the dead-weight law, and the most useful next weight."""

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

#: Excess conductance above which a pixel has contact (paper, section 4.1, as conductance); contact
#: ends below half of it.
_TOUCHED = 1.0 / (1.0 + CONTACT_PERCENT / 100.0) - 1.0
#: Excess of a short pixel, above that of any calibration.
_MOST_EXCESS = 1e5
#: First forces of a calibration with weights, newtons, at which it also reports its intervals. They
#: are spread over the range of a gripper. With these three weights, the error of real staircases
#: was 0.20 in ln force; with first weights of 0.6 to 1.2 N it was 1.0.
SPREAD_N = (1.5, 4.0, 9.0)
#: Search range of the reading of a force: 0.2 to 20 000 times the rest conductance.
_READINGS = np.geomspace(0.2, 2e4, 400)


class ForceSource(Protocol):
    """Converts frames to the present force."""

    def step(self, time_s: float, excess: ArrayLike) -> Measurement:
        """Process a frame of shape (rows, cols), and return the present force."""
        ...


class TouchDetector:
    """Detects contact of any pixel, with hysteresis.

    >>> detector = TouchDetector()
    >>> [detector.step([[excess]]) for excess in (0.05, 0.2, 0.08, 0.02)]
    [False, True, True, False]
    """

    def __init__(self) -> None:
        self._touched = False

    def step(self, excess: ArrayLike) -> bool:
        """Return whether a frame shows contact; `excess` has shape (rows, cols)."""
        highest = float(np.nanmax(np.asarray(excess, dtype=float), initial=0.0))
        self._touched = highest > _TOUCHED * (0.5 if self._touched else 1.0)
        return self._touched


class ForceFollower:
    """Estimates the force at every frame from the summed excess conductance and its history.

    Without any measured force, the law is that of other sensors, and the interval is wide:

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
        """Process a frame and return the present force; without contact, 0 with an upper limit.

        `time_s`: not earlier than that of the last frame.
        `excess`, shape (rows, cols): excess conductance; NaN for pixels without a reading.
        """
        grid = np.minimum(np.asarray(excess, dtype=float), _MOST_EXCESS)
        inputs = self._states.step(time_s, float(log_reading(np.nansum(grid))))
        return self._law.force(inputs, touched=self._touch.step(grid))


def half_width_percent(law: ForceLaw, force_n: float) -> float:
    """Return the half-width of a settled force's 90 % interval, percent of the force.

    >>> known = ForceLaw.fit([4.0, 15.0, 40.0], force_n=[1.5, 4.0, 9.0])
    >>> half_width_percent(known, 4.0) < 0.5 * half_width_percent(ForceLaw(), 4.0)
    True
    """
    (_,), (sd,) = law.log_force(build_settled_inputs(_reading_at(law, force_n)))
    return float(100.0 * np.sinh(float(ndtri(0.95)) * sd))


def most_useful_n(law: ForceLaw, *, loads_n: Sequence[float] = SPREAD_N) -> float:
    """Return the weight whose measurement would narrow the intervals most, newtons.

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
    """Return the settled excess conductance at which the law gives a force."""
    log_n = law.log_force(build_settled_inputs(_READINGS))[0]
    return float(_READINGS[np.argmin(np.abs(log_n - np.log(force_n)))])
