"""Force now of one calibrated sheet on a gripper, in newtons, without being told.

ln force = law(L) + creep . (L - its low-passed copies) + travel and backlash terms, where L is the
logarithm of sum_i excess_i ** m over pixels. With the right m the sum does not depend on how the
load spreads over the pixels. Two doubts remain: a gain that this contact has and another one would
not have, and an error that wanders. A Kalman filter carries both; servo current, where the gripper
reports one, or a force told, narrows them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from palpate.errors import CalibrationError
from palpate.estimate.creep import CreepStates, FloatArray
from palpate.estimate.measurement import Measurement
from palpate.settling.result import Status

#: Log-spaced, from a frame of a slow readout to the length of a dwell's creep.
SHEET_TIMES_S = (0.1, 0.3, 1.0, 3.0, 10.0)
#: Degree of the law in L.
DEGREE = 3
#: The spike of a movement fades with about this time constant (paper, Figure 5).
_SPIKE_S = 0.09
#: After so much opening the sheet follows the force down; closing takes the slack up again faster,
#: because force rises steeper than it fell.
_BACKLASH_MM, _TAKE_UP = 0.5, 2.0
#: A change of the reported width below this is the encoder's.
_STILL_MM = 0.06
#: Where a contact's own gain is quoted: ln of 3 N, the middle of a grasp's forces.
MIDDLE_LOG_N = float(np.log(3.0))
#: Linearisations of one reading: the force is an exponential of its errors.
_ITERATIONS = 3
#: Correlation time of the error that wanders, seconds: about a dwell.
DRIFT_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Current:
    """Servo current as a second witness: force = (current - zero) / slope, when still.

    Attributes
    ----------
    zero_ma, ma_per_n : float
        The line.
    sd_n : float
        Scatter of a single reading, newtons.
    bias_n : float
        Scatter of its mean from one placement to the next, newtons.
    """

    zero_ma: float
    ma_per_n: float
    sd_n: float
    bias_n: float

    def force_n(self, current_ma: ArrayLike) -> FloatArray:
        """Return the force that a current means, newtons."""
        return (np.asarray(current_ma, dtype=float) - self.zero_ma) / self.ma_per_n


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetModel:
    """What the guided traces taught of one sheet; see `observer_sheet_fit.fit_sheet`.

    Attributes
    ----------
    exponent : float
        m of the sum over pixels.
    time_constants_s : tuple of float
        Of the creep states; empty for a static law.
    weights : tuple of float
        Of the terms in `terms`.
    gain_sd, slope_sd, drift_sd : float
        Of ln force: of a contact's own gain, of its own exponent (per unit of ln force away from
        `MIDDLE_LOG_N`), and of the error that wanders within a contact.
    floor_n : float
        Error of a faint force, newtons: added to the wandering one.
    tail, tail_with_current : float
        Scale intervals so that they cover at their level, from the sheet alone and with current.
    range : tuple of float
        Smallest and largest L of the calibration.
    unloading_seen : bool
        Whether traces fell far enough to learn from; without, the backlash term is 0.
    current : Current or None
        Where the servo reports a current that follows the force.
    """

    exponent: float
    time_constants_s: tuple[float, ...]
    weights: tuple[float, ...]
    gain_sd: float
    slope_sd: float
    drift_sd: float
    floor_n: float
    tail: float
    tail_with_current: float
    range: tuple[float, float]
    unloading_seen: bool
    current: Current | None

    def log_force(self, terms: FloatArray) -> FloatArray:
        """Return ln force of terms, shape (..., n_terms)."""
        return np.asarray(terms @ np.asarray(self.weights))

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for a calibration file."""
        return asdict(self)


def sheet_model_from_dict(stored: dict[str, Any]) -> SheetModel:
    """Return the model that `SheetModel.as_dict` wrote.

    Raises
    ------
    CalibrationError
        If a value is missing or unknown.
    """
    try:
        current = stored["current"]
        return SheetModel(
            **{
                **stored,
                "time_constants_s": tuple(stored["time_constants_s"]),
                "weights": tuple(stored["weights"]),
                "range": (stored["range"][0], stored["range"][1]),
                "current": None if current is None else Current(**current),
            }
        )
    except (KeyError, TypeError) as error:
        raise CalibrationError(f"observer: {error}; calibrate again") from error


class SheetMemory:
    """The terms that ln force is a weighted sum of, advanced frame by frame.

    One sheet, read with several exponents m at once: the fit chooses among them.
    """

    def __init__(
        self, *, exponents: tuple[float, ...], time_constants_s: tuple[float, ...]
    ) -> None:
        self._exponents = np.array(exponents)
        self._creep = CreepStates(sensors=len(exponents), time_constants_s=time_constants_s)
        self._remembers = bool(time_constants_s)
        self._time_s = self._width_mm = float("nan")
        self._travel_mm = self._slack_mm = 0.0
        self.moved = False

    def step(self, time_s: float, excess: ArrayLike, *, width_mm: float) -> FloatArray:
        """Take one frame and return the terms, shape (exponents, n_terms).

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        excess : array_like, shape (pixels,)
            Excess conductance of each pixel; NaN where a pixel is dead.
        width_mm : float
            Reported opening; NaN where unknown: then nothing is learned of movements.
        """
        load = np.maximum(np.nan_to_num(np.asarray(excess, dtype=float)), 0.0)
        self._creep.step(time_s, (load[None, :] ** self._exponents[:, None]).sum(axis=1))
        self._move(time_s, width_mm)
        states = self._creep.states
        log_sum = states[:, :1]
        columns = [log_sum**power for power in range(DEGREE + 1)]
        if self._remembers:
            columns.append(log_sum - states[:, 1:])
            moved = np.array([[self._travel_mm, self._slack_mm]])
            columns.append(np.repeat(moved, len(states), axis=0))
        return np.concatenate(columns, axis=1)

    def _move(self, time_s: float, width_mm: float) -> None:
        step_s, step_mm = time_s - self._time_s, width_mm - self._width_mm
        self._time_s, self._width_mm = time_s, width_mm
        self.moved = False
        if not np.isfinite(step_mm):
            return
        self.moved = abs(step_mm) > _STILL_MM
        travel_mm = abs(step_mm) if self.moved else 0.0
        self._travel_mm = self._travel_mm * float(np.exp(-step_s / _SPIKE_S)) + travel_mm
        if self.moved:
            opened_mm = step_mm if step_mm > 0 else _TAKE_UP * step_mm
            self._slack_mm = min(max(self._slack_mm + opened_mm, 0.0), _BACKLASH_MM)


class SheetObserver:
    """Follow the force of one calibrated sheet from the first contact on, frame by frame.

    Parameters
    ----------
    model : SheetModel
        Learned from the guided traces.
    level : float
        Level of the intervals.

    Examples
    --------
    A sheet without memory whose summed excess, plus 0.1, is the force:

    >>> model = SheetModel(exponent=1.0, time_constants_s=(), weights=(0.0, 1.0, 0.0, 0.0),
    ...     gain_sd=0.1, slope_sd=0.1, drift_sd=0.05, floor_n=0.02, tail=1.0,
    ...     tail_with_current=1.0, range=(-1.0, 3.0), unloading_seen=True, current=None)
    >>> now = SheetObserver(model).step(0.0, [1.0, 0.9])
    >>> round(now.value, 3), now.low < 1.8, str(now.status)
    (2.0, True, 'ok')
    """

    def __init__(self, model: SheetModel, *, level: float = 0.9) -> None:
        self._model, self._level = model, level
        self._memory = SheetMemory(
            exponents=(model.exponent,), time_constants_s=model.time_constants_s
        )
        self._last_s = float("nan")
        # Errors of ln force: a contact's own gain and exponent, one that wanders; then the
        # current's own bias, newtons.
        bias_n = model.current.bias_n if model.current else 0.0
        self._mean = np.zeros(4)
        self._covariance = np.diag(
            np.square([model.gain_sd, model.slope_sd, model.drift_sd, bias_n])
        )
        self._witnessed = False
        self._log_force, self._in_range = -np.inf, False

    def step(
        self,
        time_s: float,
        excess: ArrayLike,
        *,
        width_mm: float = float("nan"),
        current_ma: float = float("nan"),
    ) -> Measurement:
        """Take one frame, with the gripper's state at its time, and return the force now.

        Parameters
        ----------
        time_s : float
            Not earlier than the last one.
        excess : array_like, shape (pixels,)
            Excess conductance of each pixel.
        width_mm, current_ma : float
            As the gripper reports them; NaN where it does not.
        """
        terms = self._memory.step(time_s, excess, width_mm=width_mm)[0]
        model, log_sum = self._model, float(terms[1])
        self._log_force = float(model.log_force(terms))
        self._in_range = model.range[0] <= log_sum <= model.range[1]
        self._wander(time_s)
        if model.current is not None and np.isfinite(current_ma) and not self._memory.moved:
            self._witnessed = True
            seen_n = float(model.current.force_n(current_ma))
            self._see(seen_n, sd_n=model.current.sd_n, biased=1.0)
        return self._now()

    def tell(self, force_n: float) -> None:
        """Take a reference force at the time of the last frame.

        Raises
        ------
        ValueError
            If the force isn't above 0.
        """
        if not force_n > 0:
            raise ValueError("the force told must be above 0 N")
        self._see(force_n, sd_n=0.01 * force_n, biased=0.0)

    def _wander(self, time_s: float) -> None:
        """Let the wandering error forget; its scatter grows where the force is faint."""
        model = self._model
        faint = model.floor_n * float(np.exp(-min(max(self._log_force, -3.0), 3.0)))
        if np.isfinite(self._last_s):
            keep = float(np.exp(-(time_s - self._last_s) / DRIFT_S))
            scale = np.array([1.0, 1.0, keep, 1.0])
            self._mean *= scale
            self._covariance *= np.outer(scale, scale)
            fresh = (model.drift_sd**2 + faint**2) * (1.0 - keep**2)
            self._covariance[2, 2] += fresh
        self._last_s = time_s

    @property
    def _reach(self) -> FloatArray:
        """How far each error state enters ln force now."""
        away = float(np.clip(self._log_force - MIDDLE_LOG_N, -3.0, 3.0))
        return np.array([1.0, away, 1.0, 0.0])

    def _see(self, seen_n: float, *, sd_n: float, biased: float) -> None:
        """Correct the errors by one reading of the force, linearised where it leads (iterated)."""
        before, reach, state = self._mean, self._reach, self._mean
        for _ in range(_ITERATIONS):
            expected_n = float(np.exp(np.clip(self._log_force - reach @ state, -7.0, 7.0)))
            slope = -expected_n * reach
            slope[3] = biased
            spread = self._covariance @ slope
            variance = float(slope @ spread) + sd_n**2
            surprise_n = seen_n - expected_n - biased * state[3] - slope @ (before - state)
            state = before + spread / variance * surprise_n
        self._mean = state
        self._covariance = self._covariance - np.outer(spread, spread) / variance

    def _now(self) -> Measurement:
        reach = self._reach
        log_force = self._log_force - float(reach @ self._mean)
        sd = float(np.sqrt(max(float(reach @ self._covariance @ reach), 0.0)))
        tail = self._model.tail_with_current if self._witnessed else self._model.tail
        half = float(norm.ppf(0.5 + self._level / 2)) * tail * sd
        return Measurement(
            value=float(np.exp(log_force)),
            low=float(np.exp(log_force - half)),
            high=float(np.exp(log_force + half)),
            unit="n",
            level=self._level,
            status=Status.OK if self._in_range else Status.SATURATED,
        )
