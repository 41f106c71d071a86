"""What a closure tells of the force: how far an object is deformed, and how far it has relaxed.

A viscoelastic object that is deformed and held loses force about evenly in ln time: a flat spectrum
of relaxation times (generalised Maxwell model; the standard picture of filled rubber and of fruit
flesh). Every further move begins anew, in proportion to its share of the deformation (Boltzmann's
superposition).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from palpate.estimate.creep import FloatArray

#: Evenly spaced in ln time, from the end of a move to well beyond a grasp.
_TIME_CONSTANTS_S = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
#: What each stands for in ln time.
_SPACING = float(np.log(_TIME_CONSTANTS_S[-1] / _TIME_CONSTANTS_S[0])) / (
    len(_TIME_CONSTANTS_S) - 1
)


class ObjectStates:
    """Deformation and relaxation of one or more objects, advanced with the closure.

    Parameters
    ----------
    objects : int
        Objects whose closures are known at the same times.

    Attributes
    ----------
    states : ndarray, shape (objects, 2)
        ln deformation, and about ln(1 + seconds held / 0.15): what is lost by relaxation, in units
        of the loss in each e-fold of time. Both are 0 where nothing is deformed.

    Examples
    --------
    Held since the first step, the loss is nearly even in the log of time:

    >>> held = ObjectStates()
    >>> for time_s in (0.0, 1.0, 4.0, 16.0):
    ...     held.step(time_s, [2.0])
    ...     print(held.states.round(1))
    [[0.7 0. ]]
    [[0.7 2.3]]
    [[0.7 3.7]]
    [[0.7 5.1]]
    """

    def __init__(self, *, objects: int = 1) -> None:
        self._time_s: float | None = None
        self._followed: FloatArray = np.zeros((objects, len(_TIME_CONSTANTS_S)))
        self._deformation: FloatArray = np.zeros(objects)
        self.states: FloatArray = np.zeros((objects, 2))

    def step(self, time_s: float, deformation: ArrayLike) -> None:
        """Take how far each object is deformed now.

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        deformation : array_like, shape (objects,)
            How far it is closed upon beyond first contact, in any unit.

        Raises
        ------
        ValueError
            If time runs backwards.
        """
        elapsed_s = 0.0 if self._time_s is None else time_s - self._time_s
        if elapsed_s < 0:
            raise ValueError(f"time runs backwards: {time_s} s after {self._time_s} s")
        # The deformation until now is that of the last step: a move counts from its end on.
        share = -np.expm1(-elapsed_s / _TIME_CONSTANTS_S)
        self._followed += share * (self._deformation[:, None] - self._followed)
        self._deformation = np.maximum(np.asarray(deformation, dtype=float), 0.0)
        self._time_s = time_s
        touched = self._deformation > 0
        way = np.where(touched, self._deformation, 1.0)
        relaxed = np.where(touched, _SPACING * self._followed.sum(axis=1) / way, 0.0)
        self.states = np.stack([np.log(way), relaxed], axis=1)
