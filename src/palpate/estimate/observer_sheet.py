"""Force now of one calibrated sheet on a gripper, in newtons, without being told.

ln force = law(L) + creep . (L - its low-passed copies) + travel and backlash terms, where L is the
logarithm of a reading that hardly depends on how the load spreads over the pixels, and the law
rises everywhere (see `sheet_memory`). Two doubts remain: a gain that this contact has and another
one would not have, and an error that wanders. A Kalman filter carries both; servo current, where
the gripper reports one, or a force told, narrows them.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import norm

from palpate.errors import CalibrationError
from palpate.estimate.creep import FloatArray
from palpate.estimate.measurement import Measurement
from palpate.estimate.sheet_memory import SheetMemory, SheetReading
from palpate.settling.result import Status

#: Where a contact's own gain is quoted: ln of 3 N, the middle of a grasp's forces.
MIDDLE_LOG_N = float(np.log(3.0))
#: So many readings of the current after a stop make one.
_READINGS = 3
#: Linearisations of one reading: the force is an exponential of its errors.
_ITERATIONS = 3
#: Correlation time of the error that wanders, seconds: about a dwell.
DRIFT_S = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Current:
    """Servo current as a second witness: force = (current - zero) / slope, when still.

    Friction of the gears holds some of the grip, or adds to it: how much depends on how the last
    movement ended, and stays until the next.

    Attributes
    ----------
    zero_ma, ma_per_n : float
        The line.
    sd_n : float
        Scatter of a single reading, newtons.
    stuck_n, stuck_share : float
        Scatter from one stop of the fingers to another: newtons, and a share of the force.
    """

    zero_ma: float
    ma_per_n: float
    sd_n: float
    stuck_n: float
    stuck_share: float

    def force_n(self, current_ma: ArrayLike) -> FloatArray:
        """Return the force that a current means, newtons."""
        return (np.asarray(current_ma, dtype=float) - self.zero_ma) / self.ma_per_n

    def stuck_sd_n(self, force_n: ArrayLike) -> FloatArray:
        """Return the scatter from stop to stop at a force, newtons."""
        return self.stuck_n + self.stuck_share * np.asarray(force_n, dtype=float)


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetModel:
    """What the guided traces taught of one sheet; see `observer_sheet_fit.fit_sheet`.

    Attributes
    ----------
    reading : SheetReading
        From pixels to one number.
    knots : tuple of float
        Where the law may bend, in L.
    time_constants_s : tuple of float
        Of the creep states; empty for a static law.
    weights : tuple of float
        Of the terms of `SheetMemory`.
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

    reading: SheetReading
    knots: tuple[float, ...]
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

    def away(self, log_force: ArrayLike) -> FloatArray:
        """Return how far a force is from where a contact's gain is quoted, in ln force."""
        return np.clip(np.asarray(log_force, dtype=float) - MIDDLE_LOG_N, -3.0, 3.0)

    def wandering_sd(self, log_force: ArrayLike) -> FloatArray:
        """Return the scatter of the error that wanders: of ln force, large where it is faint."""
        # A faint force is known to a factor of e at worst: beyond, logarithms say nothing.
        faint = np.minimum(self.floor_n * np.exp(-np.asarray(log_force, dtype=float)), 1.0)
        return np.asarray(np.hypot(self.drift_sd, faint))

    def sd(self, log_force: ArrayLike) -> FloatArray:
        """Return the scatter of ln force that the sheet alone leaves."""
        own = np.hypot(self.gain_sd, self.slope_sd * self.away(log_force))
        return np.asarray(np.hypot(own, self.wandering_sd(log_force)))

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
                "reading": SheetReading(**stored["reading"]),
                "knots": tuple(stored["knots"]),
                "time_constants_s": tuple(stored["time_constants_s"]),
                "weights": tuple(stored["weights"]),
                "range": (stored["range"][0], stored["range"][1]),
                "current": None if current is None else Current(**current),
            }
        )
    except (KeyError, TypeError) as error:
        raise CalibrationError(f"observer: {error}; calibrate again") from error


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

    >>> model = SheetModel(reading=SheetReading(exponent=1.0, touch=0.0), knots=(0.0,),
    ...     time_constants_s=(), weights=(0.0, 1.0, 1.0), gain_sd=0.1, slope_sd=0.1,
    ...     drift_sd=0.05, floor_n=0.02, tail=1.0, tail_with_current=1.0, range=(-1.0, 3.0),
    ...     unloading_seen=True, current=None)
    >>> now = SheetObserver(model).step(0.0, [1.0, 0.9])
    >>> round(now.value, 3), now.low < 1.8, str(now.status)
    (2.0, True, 'ok')
    """

    def __init__(self, model: SheetModel, *, level: float = 0.9) -> None:
        self._model, self._level = model, level
        self._memory = SheetMemory(
            model.reading, knots=model.knots, time_constants_s=model.time_constants_s
        )
        self._last_s = float("nan")
        # Errors of ln force: a contact's own gain and exponent, and one that wanders (in its own
        # standard deviations, which grow as the force gets faint).
        self._mean = np.zeros(3)
        self._covariance = np.diag(np.square([model.gain_sd, model.slope_sd, 1.0]))
        self._since_stop: list[float] = []
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
        terms = self._memory.step(time_s, excess, width_mm=width_mm)
        model = self._model
        self._log_force = float(model.log_force(terms))
        self._in_range = model.range[0] <= self._memory.log_reading <= model.range[1]
        self._wander(time_s)
        if model.current is not None and np.isfinite(current_ma):
            self._witness(model.current, current_ma)
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
        self._see(force_n, sd_n=0.01 * force_n)

    def _witness(self, current: Current, current_ma: float) -> None:
        """Take the current once after each stop: what the gears hold does not change until then."""
        if self._memory.moved:
            self._since_stop = []
            return
        self._since_stop.append(float(current.force_n(current_ma)))
        if len(self._since_stop) != _READINGS:
            return
        self._witnessed = True
        expected_n = float(np.exp(min(self._log_force - float(self._reach @ self._mean), 7.0)))
        sd_n = np.hypot(current.stuck_sd_n(expected_n), current.sd_n / np.sqrt(_READINGS))
        self._see(float(np.mean(self._since_stop)), sd_n=float(sd_n))

    def _wander(self, time_s: float) -> None:
        """Let the wandering error forget."""
        if np.isfinite(self._last_s):
            keep = float(np.exp(-(time_s - self._last_s) / DRIFT_S))
            scale = np.array([1.0, 1.0, keep])
            self._mean = self._mean * scale
            self._covariance = self._covariance * np.outer(scale, scale)
            self._covariance[2, 2] += 1.0 - keep**2
        self._last_s = time_s

    @property
    def _reach(self) -> FloatArray:
        """How far each error state enters ln force now."""
        model, log_force = self._model, self._log_force
        wandering = float(model.wandering_sd(log_force))
        return np.array([1.0, float(model.away(log_force)), wandering])

    def _see(self, seen_n: float, *, sd_n: float) -> None:
        """Correct the errors by one reading of the force, linearised where it leads (iterated)."""
        before, reach, state = self._mean, self._reach, self._mean
        for _ in range(_ITERATIONS):
            expected_n = float(np.exp(np.clip(self._log_force - reach @ state, -7.0, 7.0)))
            slope = -expected_n * reach
            spread = self._covariance @ slope
            variance = float(slope @ spread) + sd_n**2
            surprise_n = seen_n - expected_n - slope @ (before - state)
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
