"""Force now, from a sheet that creeps: gain times memory, told the force once, then on its own.

ln force = gain + weights . (ln conductance and its low-passed copies) - unloading . (recent fall)
+ object weights . (ln deformation, relaxation), the last where the closure is known. The gain
differs from place to place on a sheet and from press to press, so one reference force fixes it; how
far it can be trusted falls with time and with the change seen since.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from palpate.estimate.creep import CreepStates, FloatArray, loading_sensitivity
from palpate.estimate.object_states import ObjectStates

#: Readings kept to look back to the contact when the force is told.
LOOK_BACK_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ObserverModel:
    """What is learned from traces with a reference force; see `observer_fit.fit_observer`.

    Attributes
    ----------
    time_constants_s : tuple of float, length n_states
        Of the creep states.
    weights : tuple of float, length 1 + n_states
        Of ln conductance and of the creep states, in ln force.
    sharing : float
        How far a press's own sensitivity while loading replaces the common one: 0 not, 1 wholly.
    unloading : float
        ln force lost per unit of `CreepStates.fall`. 0 where no unloading was seen.
    spread : tuple of float, length 4
        Typical |error of ln force|: constant, per ln(1 + seconds since told / 0.1), per |change of
        ln force since|, per unit of fall since.
    tail : float
        Scales the spread so that intervals cover at their level.
    easing : float
        Under a large load a change of conductance may stand for less: it counts as force told in
        newtons to the power of minus this.
    object_weights : tuple of float, length 2
        Of `ObjectStates.states`, in ln force and eased likewise: what the closure tells beside the
        sheet. 0 where the traces did not know it.
    """

    time_constants_s: tuple[float, ...]
    weights: tuple[float, ...]
    sharing: float
    unloading: float
    spread: tuple[float, float, float, float]
    tail: float
    easing: float = 0.0
    object_weights: tuple[float, float] = (0.0, 0.0)

    def log_change(
        self,
        states: FloatArray,
        fall: FloatArray,
        *,
        closed: FloatArray,
        sensitivity: FloatArray,
        told_n: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Return the change of ln force for changes of the states and of the fall.

        Parameters
        ----------
        states : ndarray, shape (..., 1 + n_states)
            Change of the creep states since the force was told.
        fall : ndarray, shape (...)
            Change of the fall since.
        closed : ndarray, shape (..., 2)
            Change of `ObjectStates.states` since.
        sensitivity : ndarray, shape (...)
            `loading_sensitivity` when the force was told.
        told_n : ndarray, shape (...)
            That force, newtons.

        Returns
        -------
        tuple of ndarray, shape (...)
            The change while held, and by unloading.
        """
        by_sheet = states @ np.asarray(self.weights) * sensitivity**-self.sharing
        by_closure = closed @ np.asarray(self.object_weights)
        return (by_sheet + by_closure) * told_n**-self.easing, -self.unloading * fall

    def log_half_width(
        self, since_s: FloatArray, held: FloatArray, fall: FloatArray, *, level: float
    ) -> FloatArray:
        """Return the half width of the interval of ln force at `level`."""
        terms = (np.ones_like(held), np.log1p(since_s / 0.1), np.abs(held), np.abs(fall))
        typical = sum(share * term for share, term in zip(self.spread, terms, strict=True))
        return np.asarray(typical * self.tail * norm.ppf(0.5 + level / 2))


@dataclass(frozen=True, slots=True, kw_only=True)
class ForceNow:
    """The force at one time, one entry per sheet; NaN until a force was told.

    Attributes
    ----------
    value_n, low_n, high_n : ndarray, shape (sensors,)
        Force now and the ends of its interval, newtons.
    level : float
        Probability that the interval is meant to cover.
    """

    value_n: FloatArray
    low_n: FloatArray
    high_n: FloatArray
    level: float


class ForceObserver:
    """Follow the force of one or more sheets, frame by frame.

    Parameters
    ----------
    model : ObserverModel
        Learned from traces with a reference force.
    sensors : int
        Sheets that are read at the same times.
    level : float
        Level of the intervals.

    Examples
    --------
    A sheet whose creep nobody has measured: force follows conductance.

    >>> model = ObserverModel(time_constants_s=(1.0,), weights=(1.0, 0.0), sharing=0.0,
    ...     unloading=0.0, spread=(0.05, 0.0, 0.0, 0.0), tail=1.0)
    >>> observer = ForceObserver(model)
    >>> _ = observer.step(0.0, [1.9])
    >>> observer.tell([2.0])
    >>> observer.step(0.1, [3.9]).value_n.round(6).tolist()
    [4.0]
    """

    def __init__(self, model: ObserverModel, *, sensors: int = 1, level: float = 0.9) -> None:
        self._model = model
        self._level = level
        self._memory = CreepStates(sensors=sensors, time_constants_s=model.time_constants_s)
        self._recent: deque[tuple[float, FloatArray]] = deque()
        self._log_told_n = np.full(sensors, np.nan)
        self._told_s = np.full(sensors, np.nan)
        self._told_states = self._memory.states.copy()
        self._told_fall = np.zeros(sensors)
        self._object = ObjectStates(objects=sensors)
        self._told_closed = self._object.states.copy()
        self._sensitivity = np.ones(sensors)

    def step(
        self,
        time_s: float,
        excess: ArrayLike,
        *,
        resolution: ArrayLike = 0.0,
        deformation: ArrayLike | None = None,
    ) -> ForceNow:
        """Take one reading per sheet and return the force now.

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        excess : array_like, shape (sensors,)
            Excess conductance G/G0 - 1, summed over the pixels of each sheet.
        resolution : array_like, shape (sensors,) or scalar
            Change of `excess` that one digit of the readout makes at this reading.
        deformation : array_like, shape (sensors,), optional
            How far the object under each sheet is closed upon beyond first contact, in any unit.

        Raises
        ------
        ValueError
            If time runs backwards, or the model listens to the closure and it is not given.
        """
        if deformation is not None:
            self._object.step(time_s, deformation)
        elif any(self._model.object_weights):
            raise ValueError("this model was learned with the closure: give step a deformation")
        self._memory.step(time_s, excess, resolution=resolution)
        self._recent.append((time_s, self._memory.states[:, 0].copy()))
        while self._recent[0][0] < time_s - LOOK_BACK_S:
            self._recent.popleft()
        return self._now(time_s)

    def tell(self, force_n: ArrayLike) -> None:
        """Fix the gain: `force_n`, shape (sensors,), is the force at the last step.

        NaN leaves a sheet as it is.

        Raises
        ------
        ValueError
            If nothing was read yet, or a force isn't above 0.
        """
        force = np.asarray(force_n, dtype=float)
        told = ~np.isnan(force)
        if not self._recent:
            raise ValueError("tell needs a reading first: call step")
        if (force[told] <= 0).any():
            raise ValueError("the force told must be above 0 N")
        time_s = np.array([entry[0] for entry in self._recent])
        history = np.stack([entry[1] for entry in self._recent])
        self._sensitivity[told] = loading_sensitivity(time_s, history)[told]
        self._told_states[told] = self._memory.states[told]
        self._told_fall[told] = self._memory.fall[told]
        self._told_closed[told] = self._object.states[told]
        self._told_s[told] = time_s[-1]
        self._log_told_n[told] = np.log(force[told])

    def _now(self, time_s: float) -> ForceNow:
        fall = self._memory.fall - self._told_fall
        held, unloaded = self._model.log_change(
            self._memory.states - self._told_states,
            fall,
            closed=self._object.states - self._told_closed,
            sensitivity=self._sensitivity,
            told_n=np.exp(self._log_told_n),
        )
        log_force = self._log_told_n + held + unloaded
        half = self._model.log_half_width(time_s - self._told_s, held, fall, level=self._level)
        return ForceNow(
            value_n=np.exp(log_force),
            low_n=np.exp(log_force - half),
            high_n=np.exp(log_force + half),
            level=self._level,
        )
